"""MAVLink 2 on the wire: datagrams to messages and back, with pymavlink as the codec."""

from __future__ import annotations

from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation.telemetry import Message

MAGIC = 0xFD
OVERHEAD = 12  # ten of header, two of checksum
SIGNATURE = 13


class MalformedDatagramError(ValueError):
    """The rest of a datagram is no MAVLink 2."""


def split_frames(datagram: bytes) -> Iterator[bytearray]:
    """Yield the MAVLink 2 frames of a datagram; raise MalformedDatagramError where it stops being that."""
    start = 0
    while start < len(datagram):
        header = datagram[start : start + 3]
        if len(header) < 3 or header[0] != MAGIC:
            raise MalformedDatagramError(datagram[start:].hex())
        end = start + header[1] + OVERHEAD + (SIGNATURE if header[2] & 1 else 0)
        if end > len(datagram):
            raise MalformedDatagramError(datagram[start:].hex())
        yield bytearray(datagram[start:end])
        start = end


class Codec:
    """One link's encoder and decoder; what cannot be decoded is counted and dropped."""

    def __init__(self, understood: frozenset[int], component_id: int) -> None:
        self.malformed = 0
        self._understood = understood
        self._mavlink = mavlink.MAVLink(None, srcComponent=component_id)

    def decode(self, datagram: bytes) -> Iterator[Message]:
        """Yield the understood messages of a datagram."""
        try:
            for frame in split_frames(datagram):
                if int.from_bytes(frame[7:10], "little") in self._understood:
                    yield from self._messages(frame)
        except MalformedDatagramError:
            self.malformed += 1

    def encode(self, message: Message, system_id: int) -> bytes:
        """Return the frame of a message, numbered in this link's sequence."""
        self._mavlink.srcSystem = system_id
        frame: bytes = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return frame

    def _messages(self, frame: bytearray) -> list[Message]:
        try:
            return [self._mavlink.decode(frame)]
        except mavlink.MAVError:
            self.malformed += 1
            return []
