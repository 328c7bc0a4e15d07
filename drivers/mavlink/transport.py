"""The bytes under a MAVLink link: UDP in and out, and a TCP client that reconnects."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Literal, Protocol, cast

from drivers.errors import LinkError
from drivers.mavlink.codec import FrameSplitter
from drivers.tasks import background

log = logging.getLogger(__name__)

Scheme = Literal["udpin", "udpout", "tcp"]
SCHEMES: tuple[Scheme, ...] = ("udpin", "udpout", "tcp")
_ADDRESS = re.compile(r"(?P<scheme>[a-z]+):(?P<host>[^:\s]+|\[[0-9a-fA-F:]+\]):(?P<port>\d{1,5})")

FIRST_RETRY_S = 0.5
LONGEST_RETRY_S = 8.0

FrameHandler = Callable[[bytearray], None]


@dataclass(frozen=True)
class LinkAddress:
    """Where a link goes: udpin:HOST:PORT listens, udpout:HOST:PORT and tcp:HOST:PORT speak first."""

    scheme: Scheme
    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> LinkAddress:
        """Return the address written as SCHEME:HOST:PORT; LinkError says what is allowed."""
        match = _ADDRESS.fullmatch(text.strip())
        if match is None or match["scheme"] not in SCHEMES or int(match["port"]) > 65535:
            raise LinkError(
                f"link {text!r} is not SCHEME:HOST:PORT with a scheme of {', '.join(SCHEMES)}, "
                "for example udpin:127.0.0.1:14550"
            )
        host = match["host"].strip("[]")
        try:
            host.encode("idna")
        except UnicodeError as error:
            raise LinkError(f"link {text!r}: {host!r} is no host name ({error})") from error
        return cls(cast(Scheme, match["scheme"]), host, int(match["port"]))

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}:{host}:{self.port}"


class Transport(Protocol):
    """Moves whole MAVLink frames; sending never blocks and never raises: what cannot be sent is lost, as on a radio."""

    @property
    def address(self) -> LinkAddress:
        """Where this transport really is (the port chosen, where 0 was asked for)."""
        ...

    def send(self, frame: bytes) -> None:
        """Hand one frame to the network."""
        ...


@contextlib.asynccontextmanager
async def open_transport(address: LinkAddress, on_frame: FrameHandler) -> AsyncIterator[Transport]:
    """Open the transport of an address; `on_frame` gets every frame received. LinkError when it cannot be opened."""
    if address.scheme == "tcp":
        client = _TcpClient(address, on_frame)
        async with background(client.run()):
            yield client
        return
    udp = await _open_udp(address, on_frame)
    try:
        yield udp
    finally:
        udp.close()


async def _open_udp(address: LinkAddress, on_frame: FrameHandler) -> _Udp:
    where = (address.host, address.port)
    listening = address.scheme == "udpin"
    try:
        _, protocol = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: _Udp(address, on_frame),
            local_addr=where if listening else None,
            remote_addr=None if listening else where,
        )
    except (OSError, UnicodeError) as error:
        raise LinkError(
            f"link {address} cannot be opened: {error}. Is the port in use, or the host name wrong?"
        ) from error
    return protocol


class _Udp(asyncio.DatagramProtocol):
    """One UDP socket. A listening one answers to whoever spoke last."""

    def __init__(self, address: LinkAddress, on_frame: FrameHandler) -> None:
        self.address = address
        self._on_frame = on_frame
        self._splitter = FrameSplitter()
        self._transport: asyncio.DatagramTransport | None = None
        self._peer: tuple[str, int] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.DatagramTransport, transport)
        if self.address.scheme == "udpin":
            port = transport.get_extra_info("sockname")[1]
            self.address = LinkAddress(self.address.scheme, self.address.host, port)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        frames = self._splitter.datagram(data)
        if frames and self.address.scheme == "udpin":
            self._peer = addr
        for frame in frames:
            self._on_frame(frame)

    def error_received(self, exc: Exception) -> None:
        log.debug("%s: %s", self.address, exc)  # the peer's port is closed: it may come back

    def send(self, frame: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self.address.scheme == "udpout":
            self._transport.sendto(frame)
        elif self._peer is not None:
            self._transport.sendto(frame, self._peer)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()


class _TcpClient:
    """A TCP connection that comes back by itself, waiting twice as long after each failure up to a cap."""

    _WRITE_LIMIT_BYTES = 16384

    def __init__(self, address: LinkAddress, on_frame: FrameHandler) -> None:
        self.address = address
        self._on_frame = on_frame
        self._writer: asyncio.StreamWriter | None = None

    async def run(self) -> None:
        retry_s = FIRST_RETRY_S
        while True:
            try:
                reader, self._writer = await asyncio.open_connection(self.address.host, self.address.port)
                retry_s = FIRST_RETRY_S
                await self._receive(reader)
                log.warning("%s: closed by the other side, connecting again", self.address)
            except (OSError, UnicodeError) as error:
                level = logging.WARNING if retry_s == FIRST_RETRY_S else logging.DEBUG
                log.log(level, "%s: %s; trying again every %.1f s", self.address, error, retry_s)
            finally:
                self._drop()
            await asyncio.sleep(retry_s)
            retry_s = min(2 * retry_s, LONGEST_RETRY_S)

    async def _receive(self, reader: asyncio.StreamReader) -> None:
        splitter = FrameSplitter()
        while data := await reader.read(4096):
            for frame in splitter.stream(data):
                self._on_frame(frame)

    def send(self, frame: bytes) -> None:
        writer = self._writer
        if writer is None or writer.transport.get_write_buffer_size() > self._WRITE_LIMIT_BYTES:
            return  # a reader that slow would only get stale setpoints
        writer.write(frame)

    def _drop(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None
