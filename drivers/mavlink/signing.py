"""MAVLink 2 message signing on one link: frames that leave are signed, frames that arrive are judged.

With a key set, only what was signed with it may be looked at, once. The one exception says nothing about a vehicle:
the reports of a SiK radio, which cannot sign.
"""

from __future__ import annotations

import contextlib
import hmac
import logging
import zlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import Clock
from drivers.mavlink.signing_clock import UNITS_PER_S, SigningClock, open_signing_clock
from drivers.mavlink.signing_key import SigningKey

log = logging.getLogger(__name__)

SIGNED: Final = 0x01
"""The incompatibility flag of a signed frame."""
SIGNATURE_LENGTH: Final = 13
_DIGEST_LENGTH: Final = 6
_OLDEST_NEW_STREAM: Final = 60 * UNITS_PER_S

_RADIO: Final = (51, 68)
"""System and component id of a SiK radio's own reports."""
_RADIO_REPORTS: Final = frozenset({mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_RADIO})


@dataclass
class RefusedCounters:
    """Frames dropped for their signature, by what was wrong."""

    unsigned: int = 0
    wrong_signature: int = 0
    replayed: int = 0
    """Rightly signed, but with a timestamp no later than one seen, or a first one over a minute behind."""


class LinkSigner:
    """Signs and judges the frames of one link. Made by `Signing.link`."""

    def __init__(self, key: SigningKey, clock: SigningClock, link_id: int, link: str) -> None:
        self.refused = RefusedCounters()
        self.link_id = link_id
        self._key = key
        self._clock = clock
        self._link = link
        self._latest: dict[tuple[int, int, int], int] = {}

    def signature(self, frame: bytes) -> bytes:
        """Return the 13 bytes that follow a frame, whose flags and checksum say already that it is signed."""
        stamp = bytes([self.link_id]) + self._clock.next().to_bytes(6, "little")
        return stamp + self._digest(frame + stamp)

    def accepts(self, frame: bytearray) -> bool:
        """Return whether a whole frame may be looked at; one that may not is counted."""
        system_id, component_id = frame[5], frame[6]
        if not frame[2] & SIGNED:
            if (system_id, component_id) == _RADIO and int.from_bytes(frame[7:10], "little") in _RADIO_REPORTS:
                return True
            return self._refuse("unsigned", frame, "Give the vehicle the key of this link (SETUP_SIGNING).")
        if not hmac.compare_digest(self._digest(frame[:-_DIGEST_LENGTH]), bytes(frame[-_DIGEST_LENGTH:])):
            return self._refuse("wrong_signature", frame, "Give the vehicle and this link the same key.")
        timestamp = int.from_bytes(frame[-_DIGEST_LENGTH - 6 : -_DIGEST_LENGTH], "little")
        stream = (system_id, component_id, frame[-SIGNATURE_LENGTH])
        if timestamp <= self._latest.get(stream, self._clock.now() - _OLDEST_NEW_STREAM - 1):
            return self._refuse("replayed", frame, self._why_old(timestamp, known=stream in self._latest))
        self._latest[stream] = timestamp
        self._clock.hear(timestamp)
        return True

    def _digest(self, signed: bytes | bytearray) -> bytes:
        digest = self._key.digest()
        digest.update(signed)
        return digest.digest()[:_DIGEST_LENGTH]

    def _why_old(self, timestamp: int, *, known: bool) -> str:
        if known:
            return "Somebody repeats old frames, or two senders share an identity."
        behind_s = (self._clock.now() - timestamp) / UNITS_PER_S
        return f"It is {behind_s:.0f} s behind this station: check the time here, and that the vehicle has GPS time."

    def _refuse(self, reason: str, frame: bytearray, way_out: str) -> bool:
        count = getattr(self.refused, reason) + 1
        setattr(self.refused, reason, count)
        if count == 1:
            log.warning(
                "%s: a frame of system %d, component %d was dropped: %s. Further ones are only counted. %s",
                *(self._link, frame[5], frame[6], reason.replace("_", " "), way_out),
            )
        return False


@dataclass
class Signing:
    """What the signed links of a process share: the clock, and which link ids are taken."""

    clock: SigningClock
    _taken: set[int] = field(default_factory=set)

    def link(self, key: SigningKey, address: str) -> LinkSigner:
        """Return the signer of the link with this address.

        Its link id is the same in every run, as far as no other link has it: an autopilot remembers each id it
        hears and has room for few. Past 256 links ids are shared, which only links to one vehicle must not do.
        """
        first = zlib.crc32(address.encode()) % 256
        tried = ((first + offset) % 256 for offset in range(256))
        link_id = next((free for free in tried if free not in self._taken), first)
        self._taken.add(link_id)
        return LinkSigner(key, self.clock, link_id, address)


@contextlib.asynccontextmanager
async def open_signing(clock: Clock, state_file: Path | None = None) -> AsyncIterator[Signing]:
    """Yield what hands out the signers of a process. Give the machine's time, never a simulation's."""
    async with open_signing_clock(clock, state_file) as signing_clock:
        yield Signing(signing_clock)
