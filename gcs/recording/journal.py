"""The journal: every state change of a run, one JSON line each, synced to disk before the next is written."""

from __future__ import annotations

import contextlib
import json
import logging
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from gcs.errors import ServiceError

log = logging.getLogger(__name__)


class Journal:
    """Append-only. Lines are written and synced in order by one thread, so that a slow disk delays no setpoint."""

    def __init__(self, descriptor: int, path: Path, writer: ThreadPoolExecutor) -> None:
        self._descriptor = descriptor
        self._path = path
        self._writer = writer
        self._failed = False

    def append(self, entry: Mapping[str, Any]) -> None:
        """Write one entry."""
        line = json.dumps(entry, allow_nan=False) + "\n"
        self._writer.submit(self._write, line.encode())

    def _write(self, line: bytes) -> None:
        try:
            os.write(self._descriptor, line)
            os.fsync(self._descriptor)
        except OSError as error:
            if not self._failed:
                log.error("%s: %s: recording has stopped, the flight goes on", self._path, error)
            self._failed = True


@contextlib.contextmanager
def open_journal(path: Path) -> Iterator[Journal]:
    """Open a journal for appending; everything appended is on disk when the block ends."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    except OSError as error:
        raise ServiceError(f"the journal {path} cannot be opened: {error}") from error
    try:
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="journal") as writer:
            yield Journal(descriptor, path, writer)
    finally:
        os.close(descriptor)
