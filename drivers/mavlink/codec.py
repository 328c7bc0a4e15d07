"""MAVLink 2 frames to messages and back: pymavlink is the codec, framing is ours.

A frame is cut out only when its checksum holds and is decoded by itself, so that a damaged one never spoils its
neighbours; MAVLink 1 frames are not accepted.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import LinkError
from drivers.mavlink.signing import SIGNATURE_LENGTH, SIGNED, LinkSigner

Message = Any
"""A message of pymavlink's ardupilotmega dialect; pymavlink carries no types."""

MAGIC: Final = 0xFD
_HEADER_LENGTH: Final = 10
_CHECKSUM_LENGTH: Final = 2
_CRC_EXTRA: Final[dict[int, bytes]] = {
    message_id: bytes([message.crc_extra]) for message_id, message in mavlink.mavlink_map.items()
}
"""What the checksum of each known message takes in besides its frame."""
_UNFINISHED: Final = -1


@dataclass(frozen=True)
class FrameHeader:
    """What stands in the first ten bytes of a frame, before any check."""

    sequence: int
    system_id: int
    component_id: int
    message_id: int

    @classmethod
    def of(cls, frame: bytearray) -> FrameHeader:
        """Return the header of a whole frame."""
        return cls(frame[4], frame[5], frame[6], int.from_bytes(frame[7:10], "little"))


@dataclass
class FrameSplitter:
    """Cuts a byte stream, or one datagram after another, into MAVLink 2 frames; bytes between frames are counted."""

    skipped_bytes: int = 0
    _rest: bytearray = field(default_factory=bytearray)

    def datagram(self, data: bytes) -> list[bytearray]:
        """Return the whole frames of one datagram; an unfinished one at its end is skipped."""
        frames, rest = self._split(bytearray(data), goes_on=False)
        self.skipped_bytes += len(rest)
        return frames

    def stream(self, data: bytes) -> list[bytearray]:
        """Return the frames completed by the next piece of a stream; the unfinished rest is kept."""
        frames, self._rest = self._split(self._rest + data, goes_on=True)
        return frames

    def _split(self, data: bytearray, *, goes_on: bool) -> tuple[list[bytearray], bytearray]:
        frames: list[bytearray] = []
        at = 0
        while (start := data.find(MAGIC, at)) >= 0:
            self.skipped_bytes += start - at
            end = _frame_end(data, start, goes_on=goes_on)
            if end is _UNFINISHED:
                return frames, data[start:]
            if end is not None:
                frames.append(data[start:end])
                at = end
            else:  # no frame, or a damaged one: the next may begin inside what it claimed to be
                self.skipped_bytes += 1
                at = start + 1
        self.skipped_bytes += len(data) - at
        return frames, bytearray()


def _frame_end(data: bytearray, start: int, *, goes_on: bool) -> int | None:
    """Return where the sound frame at `start` ends; None if it is none, _UNFINISHED while part of it is missing."""
    if len(data) - start < _HEADER_LENGTH:
        return _UNFINISHED
    flags = data[start + 2]
    if flags & ~SIGNED:
        return None
    body_end = start + _HEADER_LENGTH + data[start + 1]
    end = body_end + _CHECKSUM_LENGTH + (SIGNATURE_LENGTH if flags else 0)
    extra = _CRC_EXTRA.get(int.from_bytes(data[start + 7 : start + 10], "little"))
    if extra is None:
        return _unknown_end(data, end, goes_on=goes_on)
    if end > len(data):
        return _UNFINISHED
    checksum = data[body_end] | data[body_end + 1] << 8
    return end if mcrf4xx(bytes(data[start + 1 : body_end]) + extra) == checksum else None


def _unknown_end(data: bytearray, end: int, *, goes_on: bool) -> int | None:
    """Return `end` when a frame with an unknown message id, whose checksum nobody can tell, does end there.

    The next frame has to follow at once, or the data to end: noise that looks like a header must not swallow the frames
    behind it.
    """
    if end < len(data):
        return end if data[end] == MAGIC else None
    if goes_on:
        return _UNFINISHED
    return end if end == len(data) else None


@dataclass
class Codec:
    """Encodes messages as one MAVLink station and decodes what others send."""

    system_id: int = 255
    component_id: int = mavlink.MAV_COMP_ID_MISSIONPLANNER
    malformed: int = 0
    signing: LinkSigner | None = None
    """With one, every frame sent is signed, and only frames signed with its key are accepted."""
    _mavlink: Message = field(init=False)

    def __post_init__(self) -> None:
        self._mavlink = mavlink.MAVLink(None, self.system_id, self.component_id)

    def encode(self, message: Message) -> bytes:
        """Return the frame of a message, numbered in this station's sequence; LinkError when a field does not fit."""
        try:
            frame = bytes(message.pack(self._mavlink))
        except (struct.error, OverflowError, TypeError, ValueError) as error:
            raise LinkError(f"{message.get_type()} cannot be sent: {error}") from error
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return frame if self.signing is None else _signed(frame, message.crc_extra, self.signing)

    def accepts(self, frame: bytearray) -> bool:
        """Return whether a frame may be looked at at all; one refused for its signature is counted by `signing`."""
        return self.signing is None or self.signing.accepts(frame)

    def decode(self, frame: bytearray) -> Message | None:
        """Return the message of one frame; None for a malformed one, which is counted, and for an unknown one."""
        if frame[0] != MAGIC or frame[2] & ~SIGNED:
            self.malformed += 1
            return None
        try:
            message = self._mavlink.decode(frame)
        except mavlink.MAVError:
            self.malformed += 1
            return None
        if message.get_type().startswith("UNKNOWN") or message.get_type() == "BAD_DATA":
            return None
        return message


def _signed(frame: bytes, crc_extra: int, signing: LinkSigner) -> bytes:
    """Return an unsigned frame as it is sent signed."""
    flagged = bytearray(frame[:-_CHECKSUM_LENGTH])
    flagged[2] |= SIGNED
    checksum = mcrf4xx(bytes(flagged[1:]) + bytes([crc_extra]))
    flagged += checksum.to_bytes(_CHECKSUM_LENGTH, "little")
    return bytes(flagged) + signing.signature(bytes(flagged))
