"""Telemetry logs: every frame of a link as it was received or sent, in a .tlog file that MAVLink tools open.

Recording never holds up a flight. The event loop only queues; a thread of its own writes. When it cannot, that is said
once, recording ends, and everything else goes on.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import re
import shutil
import struct
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Final, Protocol

from drivers.clock import Clock

log = logging.getLogger(__name__)

FLUSH_PERIOD_S: Final = 0.05
"""A killed service loses no more of a flight than the last tenth of a second."""
_TIMESTAMP: Final = struct.Struct(">Q")
_MIB: Final = 2**20


class FrameLog(Protocol):
    """Takes down the frames of one link. Never blocks, never raises."""

    def received(self, frame: bytes | bytearray) -> None:
        """Take down a frame that came in."""
        ...

    def sent(self, frame: bytes) -> None:
        """Take down a frame that was handed to the network."""
        ...


@dataclass(frozen=True)
class TlogLimits:
    """What the tlogs of a run may use, all together."""

    written_bytes: int = 8192 * _MIB
    waiting_bytes: int = 16 * _MIB
    """What may wait in memory for a disk that does not keep up; frames beyond are left out."""
    least_free_bytes: int = 64 * _MIB
    """Left on the disk for the journal, which a killed service resumes from."""
    flush_period_s: float = FLUSH_PERIOD_S
    close_timeout_s: float = 5.0
    """How long the end of a run waits for a disk that does not answer."""


def create_file(folder: Path, address: str) -> FileIO:
    """Return a new file named after a link: a run that is resumed never touches what was recorded before."""
    folder.mkdir(parents=True, exist_ok=True)
    name = re.sub(r"[^A-Za-z0-9.]+", "-", address).strip("-.")
    number = 1
    while True:
        try:
            return FileIO(folder / (f"{name}.tlog" if number == 1 else f"{name}-{number}.tlog"), "x")
        except FileExistsError:
            number += 1


CreateFile = Callable[[Path, str], FileIO]
"""Makes the file of a link, named by its address, in a folder."""


class Tlogs:
    """The tlogs of a run. Made by `open_tlogs`."""

    def __init__(self, folder: Path, clock: Clock, limits: TlogLimits, create: CreateFile = create_file) -> None:
        self.problem: str | None = None
        """Why the recording has ended or has gaps; None while every frame is recorded."""
        self.left_out = 0
        """Frames left out because too many were waiting."""
        self._folder = folder
        self._clock = clock
        self._limits = limits
        self._create = create
        self._logs: dict[str, _LinkLog] = {}
        self._queued_bytes = 0  # by the event loop only,
        self._taken_bytes = 0  # and this by the writer: neither needs a lock
        self._written_bytes = 0
        self._ended = False
        self._closing = threading.Event()
        self._writer = threading.Thread(target=self._write_until_closed, name="tlog", daemon=True)

    @property
    def recording(self) -> bool:
        """Whether frames are still being recorded."""
        return not self._ended

    def of(self, address: object) -> FrameLog:
        """Return the log of the link with this address."""
        return self._logs.setdefault(str(address), _LinkLog(self, str(address)))

    def queue(self, link_log: _LinkLog, frame: bytes | bytearray) -> None:
        """Let a frame wait for the writer."""
        if self._ended:
            return
        record = _TIMESTAMP.pack(self._clock.unix_ns() // 1000) + frame
        if self._queued_bytes - self._taken_bytes + len(record) > self._limits.waiting_bytes:
            self.left_out += 1
            if self.left_out == 1:
                self._say("frames are left out: the disk does not keep up")
            return
        self._queued_bytes += len(record)
        link_log.waiting.append(record)

    def start(self) -> None:
        """Begin to write."""
        self._writer.start()

    async def close(self) -> None:
        """Write what waits. A disk that does not answer is not waited for any longer than some seconds."""
        self._closing.set()
        await asyncio.to_thread(self._writer.join, self._limits.close_timeout_s)
        if self._writer.is_alive():
            self._say(f"the disk does not answer within {self._limits.close_timeout_s:g} s: frames may be missing")

    def _write_until_closed(self) -> None:
        try:
            while not self._closing.wait(self._limits.flush_period_s) and not self._ended:
                self._write_waiting()
            self._write_waiting()
        except OSError as error:
            self._end(error.strerror or str(error))
        for link_log in list(self._logs.values()):
            link_log.close()

    def _write_waiting(self) -> None:
        written_before = self._written_bytes
        for link_log in list(self._logs.values()):
            data = link_log.take()
            self._taken_bytes += len(data)
            if data and not self._ended:
                self._write(link_log, data)
        if not self._ended and self._written_bytes > written_before:
            least_free = self._limits.least_free_bytes
            if shutil.disk_usage(self._folder).free < least_free:
                self._end(f"less than {least_free / _MIB:.0f} MiB are free on the disk")

    def _write(self, link_log: _LinkLog, data: bytes) -> None:
        limits = self._limits
        self._written_bytes += len(data)
        if self._written_bytes > limits.written_bytes:
            self._end(f"their limit of {limits.written_bytes / _MIB:.0f} MiB is reached")
            return
        if link_log.file is None:
            link_log.file = self._create(self._folder, link_log.address)
        _append(link_log.file, data)

    def _end(self, why: str) -> None:
        self._ended = True
        self._say(f"recording has ended: {why}")

    def _say(self, problem: str) -> None:
        self.problem = f"tlogs in {self._folder}: {problem}"
        log.error("%s. The flight goes on", self.problem)


@dataclass
class _LinkLog:
    """The frames of one link that wait, and the file they go to."""

    tlogs: Tlogs
    address: str
    waiting: deque[bytes] = field(default_factory=deque)
    file: FileIO | None = None

    def received(self, frame: bytes | bytearray) -> None:
        """Take down a frame that came in."""
        self.tlogs.queue(self, frame)

    def sent(self, frame: bytes) -> None:
        """Take down a frame that was handed to the network."""
        self.tlogs.queue(self, frame)

    def take(self) -> bytes:
        """Return the records that wait, and forget them; the event loop may add more meanwhile."""
        return b"".join([self.waiting.popleft() for _ in range(len(self.waiting))])

    def close(self) -> None:
        """Forget what waits, and close the file."""
        self.waiting.clear()
        if self.file is not None:
            with contextlib.suppress(OSError):
                self.file.close()


def _append(file: FileIO, data: bytes) -> None:
    """Append whole records; OSError when they do not fit, and then none of them stays half written."""
    before = file.tell()
    rest = memoryview(data)
    try:
        while rest:
            rest = rest[file.write(rest) :]
    except OSError:
        with contextlib.suppress(OSError):
            os.ftruncate(file.fileno(), before)
        raise


@contextlib.asynccontextmanager
async def open_tlogs(folder: Path, clock: Clock, limits: TlogLimits | None = None) -> AsyncIterator[Tlogs]:
    """Yield the tlogs of a run, written to `folder`; all that was recorded is in the files when the block ends."""
    tlogs = Tlogs(folder, clock, limits or TlogLimits())
    tlogs.start()
    try:
        yield tlogs
    finally:
        await tlogs.close()
