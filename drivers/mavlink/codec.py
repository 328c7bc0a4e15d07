"""MAVLink 2 frames to messages and back: pymavlink is the codec, framing is ours.

A frame is cut out only when its checksum holds and is decoded by itself, so that a damaged one never spoils its
neighbours; MAVLink 1 frames are not accepted.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import LinkError

Message = Any
"""A message of pymavlink's ardupilotmega dialect; pymavlink carries no types."""

MAGIC: Final = 0xFD
_HEADER_LENGTH: Final = 10
_CHECKSUM_LENGTH: Final = 2
_SIGNATURE_LENGTH: Final = 13
_SIGNED: Final = 0x01


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
        frames, rest = self._split(bytearray(data))
        self.skipped_bytes += len(rest)
        return frames

    def stream(self, data: bytes) -> list[bytearray]:
        """Return the frames completed by the next piece of a stream; the unfinished rest is kept."""
        frames, self._rest = self._split(self._rest + data)
        return frames

    def _split(self, data: bytearray) -> tuple[list[bytearray], bytearray]:
        frames: list[bytearray] = []
        at = 0
        while (start := data.find(MAGIC, at)) >= 0:
            self.skipped_bytes += start - at
            end = _frame_end(data, start)
            if end is None:
                return frames, data[start:]
            if _is_sound(data, start):
                frames.append(data[start:end])
                at = end
            else:  # no frame, or a damaged one: the next may begin inside what it claimed to be
                self.skipped_bytes += 1
                at = start + 1
        self.skipped_bytes += len(data) - at
        return frames, bytearray()


def _frame_end(data: bytearray, start: int) -> int | None:
    """Return where the frame beginning at `start` ends by its own account; None when that is not all there yet."""
    if len(data) - start < _HEADER_LENGTH:
        return None
    signature = _SIGNATURE_LENGTH if data[start + 2] & _SIGNED else 0
    end = start + _HEADER_LENGTH + data[start + 1] + _CHECKSUM_LENGTH + signature
    return end if len(data) >= end else None


def _is_sound(data: bytearray, start: int) -> bool:
    """Return whether a frame's flags are known and its checksum holds, as far as its message id is known."""
    if data[start + 2] & ~_SIGNED:
        return False
    message = mavlink.mavlink_map.get(int.from_bytes(data[start + 7 : start + 10], "little"))
    if message is None:
        return True
    body_end = start + _HEADER_LENGTH + data[start + 1]
    checksum: int = mavlink.x25crc(bytes(data[start + 1 : body_end]) + bytes([message.crc_extra])).crc
    return checksum == int.from_bytes(data[body_end : body_end + _CHECKSUM_LENGTH], "little")


@dataclass
class Codec:
    """Encodes messages as one MAVLink station and decodes what others send."""

    system_id: int = 255
    component_id: int = mavlink.MAV_COMP_ID_MISSIONPLANNER
    malformed: int = 0
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
        return frame

    def decode(self, frame: bytearray) -> Message | None:
        """Return the message of one frame; None for a malformed one, which is counted, and for an unknown one."""
        if frame[0] != MAGIC or frame[2] & ~_SIGNED:
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
