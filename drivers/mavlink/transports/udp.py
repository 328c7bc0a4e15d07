"""MAVLink over one UDP socket: `udpout` speaks to one address, `udpin` answers whoever speaks (see `peers`).

A socket is read until it is empty at each wake-up, and nothing is queued here: what the kernel does not take is lost.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import AsyncIterator
from typing import Final

from drivers.errors import LinkError
from drivers.mavlink.codec import FrameSplitter
from drivers.mavlink.transport import FrameHandler, LinkAddress
from drivers.mavlink.transports.peers import Peers

log = logging.getLogger(__name__)

_DATAGRAMS_AT_ONCE: Final = 64
"""A flood waits for everybody else's turn after so many."""
_LARGEST_DATAGRAM: Final = 65535


@contextlib.asynccontextmanager
async def open_udp(address: LinkAddress, on_frame: FrameHandler) -> AsyncIterator[UdpSocket]:
    """Open the socket of a udpin or udpout address. LinkError when the port is in use or the host unknown."""
    try:
        opened = await _open_socket(address)
    except (OSError, UnicodeError) as error:
        raise LinkError(
            f"link {address} cannot be opened: {error}. Is the port in use, or the host name wrong?"
        ) from error
    loop = asyncio.get_running_loop()
    with opened:
        udp = UdpSocket(opened, address, on_frame, loop)
        loop.add_reader(opened, udp.receive)
        try:
            yield udp
        finally:
            loop.remove_reader(opened)


async def _open_socket(address: LinkAddress) -> socket.socket:
    """Return a non-blocking socket, bound or connected to the first of the host's addresses that allows it."""
    listening = address.scheme == "udpin"
    found = await asyncio.get_running_loop().getaddrinfo(
        address.host, address.port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE if listening else 0
    )
    failure = OSError("no address found")
    for family, kind, protocol, _, where in found:
        opened = socket.socket(family, kind, protocol)
        opened.settimeout(0.0)
        try:
            if listening:
                opened.bind(where)
            else:
                opened.connect(where)
        except OSError as error:
            opened.close()
            failure = error
        else:
            return opened
    raise failure


class UdpSocket:
    """One UDP socket as a transport."""

    connected = True
    backlogged = False

    def __init__(
        self, opened: socket.socket, address: LinkAddress, on_frame: FrameHandler, loop: asyncio.AbstractEventLoop
    ) -> None:
        self.refused = 0
        self._socket = opened
        self._on_frame = on_frame
        self._loop = loop
        self._splitter = FrameSplitter()
        self._peers = Peers() if address.scheme == "udpin" else None
        port = address.port if self._peers is None else opened.getsockname()[1]
        self.address = LinkAddress(address.scheme, address.host, port)

    @property
    def skipped_bytes(self) -> int:
        """Bytes received that were no frame."""
        return self._splitter.skipped_bytes

    @property
    def contested_system_ids(self) -> frozenset[int]:
        """System ids whose autopilots have lately been heard from two addresses at a time."""
        return frozenset() if self._peers is None else self._peers.contested(self._loop.time())

    def receive(self) -> None:
        """Take in what has arrived."""
        now_s = self._loop.time()
        for _ in range(_DATAGRAMS_AT_ONCE):
            try:
                data, source = self._socket.recvfrom(_LARGEST_DATAGRAM)
            except ConnectionError:
                continue  # the peer's port was closed when we spoke: it may come back
            except OSError:
                return  # empty
            for frame in self._splitter.datagram(data):
                if self._peers is None:
                    self._on_frame(frame)
                elif not self._peers.admits(frame, source, now_s):
                    self._refuse(frame, source)
                elif self._on_frame(frame):
                    self._peers.heard(frame, source, now_s)
                else:
                    self._peers.knocked(source)

    def send(self, frame: bytes, system_id: int = 0) -> bool:
        """Send to the peer; of a listening socket, to the system's address or to all peers."""
        if self._peers is None:
            return self._send_connected(frame)
        sent = False
        for source in self._peers.of(system_id):
            try:
                self._socket.sendto(frame, source)
                sent = True
            except OSError as error:
                log.debug("%s: to %s: %s", self.address, source, error)
        return sent

    def _send_connected(self, frame: bytes) -> bool:
        for _ in range(2):
            try:
                self._socket.send(frame)
            except ConnectionError:
                continue  # about an earlier frame: this one has not been tried yet
            except OSError as error:
                log.debug("%s: %s", self.address, error)
                return False
            return True
        return False

    def _refuse(self, frame: bytearray, source: object) -> None:
        self.refused += 1
        log.log(
            logging.WARNING if self.refused == 1 else logging.DEBUG,
            "%s: system id %d is also heard from %s: refused while the first address speaks",
            self.address,
            frame[5],
            source,
        )
