"""MAVLink over a TCP connection that comes back by itself.

TCP keeps what it cannot deliver and delivers it in the end, which no setpoint survives: a connection on which nothing
is acknowledged any more is dropped together with what waits in it, and so is one on which nothing is heard any more,
for the other side may have stopped without closing it.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import logging
import socket
import struct
import termios
from collections.abc import AsyncIterator
from typing import Final, cast

from drivers.mavlink.codec import FrameSplitter
from drivers.mavlink.transport import FrameHandler, LinkAddress
from drivers.mavlink.transports.retry import Retry
from drivers.tasks import background

log = logging.getLogger(__name__)

CONNECT_TIMEOUT_S: Final = 10.0
SILENT_S: Final = 5.0
"""An autopilot's heartbeat comes each second: a connection silent for this long is made anew."""
BACKLOG_S: Final = 0.5
"""With nothing acknowledged for this long, as long as a lease, motions are not sent into the queue any more."""
STALLED_S: Final = 2.0
"""With nothing acknowledged for this long, the connection and its queue are dropped."""
_WATCH_PERIOD_S: Final = 0.5
_WRITE_LIMIT_BYTES: Final = 16384


@contextlib.asynccontextmanager
async def open_tcp(address: LinkAddress, on_frame: FrameHandler) -> AsyncIterator[TcpClient]:
    """Connect to an address, again and again if need be, until the block ends."""
    client = TcpClient(address, on_frame)
    async with background(client.run()):
        yield client


class TcpClient:
    """A TCP connection as a transport."""

    refused = 0
    contested_system_ids: frozenset[int] = frozenset()

    def __init__(self, address: LinkAddress, on_frame: FrameHandler) -> None:
        self.address = address
        self._on_frame = on_frame
        self._connection: _Connection | None = None
        self._skipped_before = 0

    @property
    def connected(self) -> bool:
        """Whether there is a connection."""
        return self._connection is not None

    @property
    def backlogged(self) -> bool:
        """Whether the other side has acknowledged nothing for a while although something waits."""
        return self._connection is not None and self._connection.stalled_for_s() > BACKLOG_S

    @property
    def skipped_bytes(self) -> int:
        """Bytes received that were no frame, on all connections so far."""
        return self._skipped_before + (0 if self._connection is None else self._connection.splitter.skipped_bytes)

    def send(self, frame: bytes, system_id: int = 0) -> bool:  # noqa: ARG002 - one peer takes all
        """Write to the connection, unless there is none or it takes nothing."""
        return self._connection is not None and self._connection.write(frame)

    async def run(self) -> None:
        """Keep connected until cancelled."""
        retry = Retry(self.address)
        while True:
            try:
                why = await self._connect_once(retry)
            except (OSError, UnicodeError) as error:  # TimeoutError is an OSError
                why = str(error) or "no answer"
            await retry.failed(why)

    async def _connect_once(self, retry: Retry) -> str:
        """Return why the connection ended."""
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            _, connection = await loop.create_connection(
                lambda: _Connection(self._on_frame, retry, loop), self.address.host, self.address.port
            )
        self._connection = connection
        try:
            return await connection.end()
        finally:
            self._connection = None
            self._skipped_before += connection.splitter.skipped_bytes
            connection.transport.close()


class _Connection(asyncio.Protocol):
    """One connection, from its beginning to its end."""

    transport: asyncio.Transport

    def __init__(self, on_frame: FrameHandler, retry: Retry, loop: asyncio.AbstractEventLoop) -> None:
        self.splitter = FrameSplitter()
        self._on_frame = on_frame
        self._retry = retry
        self._loop = loop
        self._closed = loop.create_future()
        self._heard_s = self._progress_s = loop.time()
        self._written = self._acknowledged = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast(asyncio.Transport, transport)

    def data_received(self, data: bytes) -> None:
        self._heard_s = self._loop.time()
        for frame in self.splitter.stream(data):
            self._retry.succeeded()
            self._on_frame(frame)

    def connection_lost(self, exc: Exception | None) -> None:
        if not self._closed.done():
            self._closed.set_result(str(exc) if exc else "closed by the other side")

    async def end(self) -> str:
        """Return why the connection ended, ending it when it is dead."""
        while True:
            done, _ = await asyncio.wait((self._closed,), timeout=_WATCH_PERIOD_S)
            if done:
                return str(self._closed.result())
            if self.stalled_for_s() > STALLED_S:
                self._discard()
                return f"nothing acknowledged for {STALLED_S:g} s"
            if self._loop.time() - self._heard_s > SILENT_S:
                self._discard()
                return f"nothing heard for {SILENT_S:g} s"

    def write(self, frame: bytes) -> bool:
        if self.transport.is_closing() or self.transport.get_write_buffer_size() > _WRITE_LIMIT_BYTES:
            return False
        self._note_progress()
        self.transport.write(frame)
        self._written += len(frame)
        return True

    def stalled_for_s(self) -> float:
        """Return for how long something has waited without any of it being acknowledged, s."""
        return self._loop.time() - self._progress_s if self._note_progress() else 0.0

    def _note_progress(self) -> bool:
        """Return whether anything waits."""
        waiting = self._waiting_bytes()
        acknowledged = self._written - waiting
        if waiting == 0 or acknowledged > self._acknowledged:
            self._progress_s, self._acknowledged = self._loop.time(), acknowledged
        return waiting > 0

    def _waiting_bytes(self) -> int:
        """Return how much the other side has not acknowledged, here and in the kernel's queue."""
        opened = self._socket()
        if opened.fileno() < 0:
            return 0
        in_kernel: int = struct.unpack("i", fcntl.ioctl(opened.fileno(), termios.TIOCOUTQ, bytes(4)))[0]
        return in_kernel + self.transport.get_write_buffer_size()

    def _discard(self) -> None:
        """Close the connection and forget what waits in it."""
        self._socket().setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.transport.abort()

    def _socket(self) -> socket.socket:
        return cast(socket.socket, self.transport.get_extra_info("socket"))
