"""A file of lines, written in order by one thread of its own, so that a slow disk delays no setpoint."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from gcs.errors import ServiceError

log = logging.getLogger(__name__)


Tell = Callable[[str], None]
"""Puts a message before the operator; it is called in a thread of its own."""


class LineFile:
    """Append-only. A line that could not be written whole is lost, and spoils no other."""

    def __init__(self, descriptor: int, path: Path, writer: ThreadPoolExecutor, tell: Tell, *, synced: bool) -> None:
        self._descriptor = descriptor
        self._path = path
        self._writer = writer
        self._tell = tell
        self._synced = synced
        self._lost = 0
        size = os.fstat(descriptor).st_size
        self._torn = size > 0 and os.pread(descriptor, 1, size - 1) != b"\n"

    def append(self, line: bytes) -> None:
        """Write one line, given without its end."""
        self._writer.submit(self._write, line)

    def _write(self, line: bytes) -> None:
        whole = (b"\n" if self._torn else b"") + line + b"\n"
        try:
            written = os.write(self._descriptor, whole)
            self._torn = written < len(whole)
            if self._torn:
                raise OSError(f"only {written} of {len(whole)} bytes fitted")
            if self._synced:
                os.fsync(self._descriptor)
        except OSError as error:
            self._lost += 1
            if self._lost == 1:
                self._tell(f"{self._path}: {error}: recording has stopped, the flight goes on")
            return
        if self._lost:
            self._tell(f"{self._path}: it can be written again; {self._lost} lines are lost")
            self._lost = 0


@contextlib.contextmanager
def open_lines(path: Path, *, synced: bool, say: Tell | None = None) -> Iterator[LineFile]:
    """Open a file for appending; everything appended is written when the block ends. ServiceError when it cannot be.

    `synced`: every line is on the disk itself before the next is written. `say` is told on the event loop when it
    cannot be written any more, and when it can be again; without it only the program's log is.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    except OSError as error:
        raise ServiceError(f"{path} cannot be opened for recording: {error}") from error
    tell = _telling(say)
    try:
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix=path.stem) as writer:
            yield LineFile(descriptor, path, writer, tell, synced=synced)
    finally:
        os.close(descriptor)


def _telling(say: Tell | None) -> Tell:
    """Return what logs, and tells the event loop that runs now where somebody there is to be told."""
    loop = None if say is None else asyncio.get_running_loop()

    def tell(message: str) -> None:
        log.error("%s", message)
        if say is not None and loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop may have closed meanwhile
                loop.call_soon_threadsafe(say, message)

    return tell
