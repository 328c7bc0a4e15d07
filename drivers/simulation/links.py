"""The UDP links of a simulated vehicle."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

Address = tuple[str, int]
LARGEST_DATAGRAM = 65535


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """`udpout:HOST:PORT` (speak first, to there) or `udpin:HOST:PORT` (wait there for someone to speak)."""

    kind: str
    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> LinkAddress:
        """Return the address a text names; ValueError says what is wrong with it."""
        kind, _, rest = text.partition(":")
        host, _, port = rest.rpartition(":")
        if kind not in ("udpin", "udpout") or not host or not port.isdecimal() or not 0 < int(port) < 65536:
            msg = f"{text!r} is not a link: expected udpout:HOST:PORT or udpin:HOST:PORT"
            raise ValueError(msg)
        return cls(kind, host, int(port))


class UdpLink:
    """A non-blocking UDP socket that talks to one peer: the given one, or whoever spoke last.

    Opening raises OSError. Datagrams that cannot be sent are lost, as on a radio.
    """

    def __init__(self, address: LinkAddress) -> None:
        resolved: Address = (socket.gethostbyname(address.host), address.port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(0.0)
        self._peer: Address | None = None
        self._connected = address.kind == "udpout"
        try:
            if self._connected:
                self.socket.connect(resolved)
            else:
                self.socket.bind(resolved)
        except OSError:
            self.socket.close()
            raise

    def receive(self) -> Iterator[bytes]:
        """Yield the datagrams that have arrived."""
        while True:
            try:
                datagram, self._peer = self.socket.recvfrom(LARGEST_DATAGRAM)
            except BlockingIOError:
                return
            except ConnectionError:  # nobody listened to what was sent before
                continue
            yield datagram

    def send(self, frame: bytes) -> None:
        """Send to the peer, if there is one yet."""
        with suppress(OSError):
            if self._connected:
                self.socket.send(frame)
            elif self._peer:
                self.socket.sendto(frame, self._peer)

    def close(self) -> None:
        """Give the port back."""
        self.socket.close()
