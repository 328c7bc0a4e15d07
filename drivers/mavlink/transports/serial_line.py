"""MAVLink over a serial line: a telemetry radio or a cable that may be unplugged and come back.

pyserial opens and sets up the device, by its own name for it and at any rate; reading and writing are ours, so that
neither ever waits. Frames go out whole or not at all.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import importlib
import logging
import os
import struct
import termios
from collections.abc import AsyncIterator, Callable
from typing import Any, Final

from drivers.errors import LinkError
from drivers.mavlink.codec import FrameSplitter
from drivers.mavlink.transport import FrameHandler, LinkAddress
from drivers.mavlink.transports.retry import Retry
from drivers.tasks import background

log = logging.getLogger(__name__)

BACKLOG_S: Final = 0.15
"""A motion that would wait for longer than this in the output queue is not sent."""
_BITS_PER_BYTE: Final = 10
_LARGEST_FRAME: Final = 280
_READ_BYTES: Final = 4096

OpenPort = Callable[[], Any]
"""Opens and sets up the device; pyserial carries no types."""


@contextlib.asynccontextmanager
async def open_serial_line(address: LinkAddress, on_frame: FrameHandler) -> AsyncIterator[SerialLine]:
    """Keep a serial line open, again and again if need be, until the block ends. LinkError without pyserial."""
    try:
        serial = importlib.import_module("serial")
    except ModuleNotFoundError as error:
        raise LinkError(f"link {address} needs pyserial: pip install 'bearing-relay[serial]'") from error

    def open_port() -> Any:
        return serial.Serial(address.host, address.port, timeout=0, write_timeout=0, exclusive=True)

    line = SerialLine(address, on_frame, open_port)
    async with background(line.run()):
        yield line


class SerialLine:
    """A serial line as a transport."""

    refused = 0
    contested_system_ids: frozenset[int] = frozenset()

    def __init__(self, address: LinkAddress, on_frame: FrameHandler, open_port: OpenPort) -> None:
        self.address = address
        self._on_frame = on_frame
        self._open_port = open_port
        self._port: _Port | None = None
        self._skipped_before = 0

    @property
    def connected(self) -> bool:
        """Whether the device is open."""
        return self._port is not None

    @property
    def backlogged(self) -> bool:
        """Whether the output queue is full, or takes longer than BACKLOG_S to empty at the line's rate."""
        if self._port is None:
            return False
        limit = max(_LARGEST_FRAME, BACKLOG_S * self.address.port / _BITS_PER_BYTE)
        return self._port.full or self._port.waiting_bytes() > limit

    @property
    def skipped_bytes(self) -> int:
        """Bytes received that were no frame, since the link was opened."""
        return self._skipped_before + (0 if self._port is None else self._port.splitter.skipped_bytes)

    def send(self, frame: bytes, system_id: int = 0) -> bool:  # noqa: ARG002 - a line has one other end
        """Write a frame, unless the device is gone or its output queue is full."""
        return self._port is not None and self._port.write(frame)

    async def run(self) -> None:
        """Keep the device open until cancelled."""
        retry = Retry(self.address)
        while True:
            try:
                why = await self._use_once(retry)
            except (OSError, ValueError, termios.error) as error:  # pyserial's errors are OSErrors
                why = f"{error}. Is it plugged in, at this baud rate, free, and may this user open it?"
            await retry.failed(why)

    async def _use_once(self, retry: Retry) -> str:
        """Return why the device cannot be used any more."""
        opened = await asyncio.to_thread(self._open_port)  # some devices take their time
        with contextlib.closing(_Port(opened, self._on_frame, retry)) as port:
            self._port = port
            try:
                return await port.gone
            finally:
                self._port = None
                self._skipped_before += port.splitter.skipped_bytes


class _Port:
    """An open device, from plugging in to unplugging."""

    def __init__(self, port: Any, on_frame: FrameHandler, retry: Retry) -> None:
        self.splitter = FrameSplitter()
        self._loop = asyncio.get_running_loop()
        self.gone: asyncio.Future[str] = self._loop.create_future()
        self._port = port
        self._fd: int = port.fileno()
        self._on_frame = on_frame
        self._retry = retry
        self._rest = b""
        self._loop.add_reader(self._fd, self._read)

    @property
    def full(self) -> bool:
        """Whether a frame taken in part waits for room."""
        return bool(self._rest)

    def write(self, frame: bytes) -> bool:
        """Give a frame to the kernel; what it takes in part is finished before anything else."""
        if self._rest or self.gone.done():
            return False
        try:
            taken = os.write(self._fd, frame)
        except BlockingIOError:
            return False
        except OSError as error:
            self._lose(str(error))
            return False
        if taken == 0:
            return False
        self._keep(frame[taken:])
        return True

    def waiting_bytes(self) -> int:
        """Return how much the kernel has not put on the line yet."""
        try:
            return int(struct.unpack("i", fcntl.ioctl(self._fd, termios.TIOCOUTQ, bytes(4)))[0])
        except OSError:
            return 0  # unplugged: reading says so

    def close(self) -> None:
        """Let go of the device. What still waits in one that is there goes out, and nobody waits for it."""
        self._loop.remove_reader(self._fd)
        self._loop.remove_writer(self._fd)
        self._loop.run_in_executor(None, _close, self._port, self.gone.done())

    def _keep(self, rest: bytes) -> None:
        self._rest = rest
        if rest:
            self._loop.add_writer(self._fd, self._write_rest)

    def _write_rest(self) -> None:
        try:
            taken = os.write(self._fd, self._rest)
        except BlockingIOError:
            return
        except OSError as error:
            self._loop.remove_writer(self._fd)
            self._lose(str(error))
            return
        self._rest = self._rest[taken:]
        if not self._rest:
            self._loop.remove_writer(self._fd)

    def _read(self) -> None:
        try:
            data = os.read(self._fd, _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(str(error))
            return
        if not data:
            self._lose("no device any more")
            return
        for frame in self.splitter.stream(data):
            self._retry.succeeded()
            self._on_frame(frame)

    def _lose(self, why: str) -> None:
        self._loop.remove_reader(self._fd)
        if not self.gone.done():
            self.gone.set_result(why)


def _close(port: Any, gone: bool) -> None:
    if gone:
        with contextlib.suppress(OSError, termios.error):
            port.reset_output_buffer()  # closing would wait for it
    with contextlib.suppress(OSError, termios.error):
        port.close()
