"""The seam under a MAVLink link: where a link goes, and what its transport must do (they are in `transports`)."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, cast

from drivers.errors import LinkError

Scheme = Literal["udpin", "udpout", "tcp", "serial"]
_HOST_AND_PORT = re.compile(r"(?P<scheme>udpin|udpout|tcp):(?P<host>[^:\s]+|\[[0-9a-fA-F:]+\]):(?P<port>\d{1,5})")
_SERIAL_LINE = re.compile(r"serial:(?P<device>\S+):(?P<baud>[1-9]\d{1,6})")  # a device's name may have colons too

FrameHandler = Callable[[bytearray], bool]
"""Takes one received frame; False when it was refused, so that its sender must not be answered."""


@dataclass(frozen=True)
class LinkAddress:
    """Where a link goes: udpin:HOST:PORT listens; udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD speak first."""

    scheme: Scheme
    host: str
    """The host; of a serial line, its device."""
    port: int
    """The port; of a serial line, its baud rate."""

    @classmethod
    def parse(cls, text: str) -> LinkAddress:
        """Return the address as written; LinkError says what is allowed."""
        serial = _SERIAL_LINE.fullmatch(text.strip())
        if serial is not None:
            return cls("serial", serial["device"], int(serial["baud"]))
        match = _HOST_AND_PORT.fullmatch(text.strip())
        if match is None or int(match["port"]) > 65535:
            raise LinkError(
                f"link {text!r} is not SCHEME:HOST:PORT with a scheme of udpin, udpout, tcp, nor serial:DEVICE:BAUD; "
                "for example udpin:127.0.0.1:14550 or serial:/dev/ttyUSB0:57600"
            )
        host = match["host"].strip("[]")
        try:
            host.encode("idna")
        except UnicodeError as error:
            raise LinkError(f"link {text!r}: {host!r} is no host name ({error})") from error
        return cls(cast(Scheme, match["scheme"]), host, int(match["port"]))

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host and self.scheme != "serial" else self.host
        return f"{self.scheme}:{host}:{self.port}"


class Transport(Protocol):
    """Moves whole MAVLink frames; sending never blocks and never raises: what cannot be sent is lost, as on a radio."""

    @property
    def address(self) -> LinkAddress:
        """Where this transport really is (the port chosen, where 0 was asked for)."""
        ...

    @property
    def connected(self) -> bool:
        """Whether there is something to send to and to hear from, as far as this machine can tell."""
        ...

    @property
    def backlogged(self) -> bool:
        """Whether what is sent now would wait behind what the other side does not take: nothing for a motion."""
        ...

    @property
    def skipped_bytes(self) -> int:
        """Bytes received that were no frame."""
        ...

    @property
    def refused(self) -> int:
        """Frames not handed on because another address speaks for their system."""
        ...

    @property
    def contested_system_ids(self) -> frozenset[int]:
        """System ids whose autopilots have lately been heard from two addresses at a time."""
        ...

    def send(self, frame: bytes, system_id: int = 0) -> bool:
        """Hand one frame to the network for a system, or for all (0); False when it is lost already."""
        ...
