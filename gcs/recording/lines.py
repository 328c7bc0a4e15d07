"""A file of lines, written in order by one thread of its own, so that a slow disk delays no setpoint."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from gcs.errors import ServiceError

log = logging.getLogger(__name__)


class LineFile:
    """Append-only. A line that could not be written whole is lost, and spoils no other."""

    def __init__(self, descriptor: int, path: Path, writer: ThreadPoolExecutor, *, synced: bool) -> None:
        self._descriptor = descriptor
        self._path = path
        self._writer = writer
        self._synced = synced
        self._failed = False
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
            if not self._failed:
                log.error("%s: %s: recording has stopped, the flight goes on", self._path, error)
            self._failed = True


@contextlib.contextmanager
def open_lines(path: Path, *, synced: bool) -> Iterator[LineFile]:
    """Open a file for appending; everything appended is written when the block ends. ServiceError when it cannot be.

    `synced`: every line is on the disk itself before the next is written.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    except OSError as error:
        raise ServiceError(f"{path} cannot be opened for recording: {error}") from error
    try:
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix=path.stem) as writer:
            yield LineFile(descriptor, path, writer, synced=synced)
    finally:
        os.close(descriptor)
