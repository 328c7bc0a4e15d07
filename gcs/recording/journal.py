"""The journal: every state change of a run, one JSON line each, synced to disk before the next is written."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gcs.recording.lines import LineFile, open_lines


class Journal:
    """Append-only; entries come out in the order they were appended."""

    def __init__(self, lines: LineFile) -> None:
        self._lines = lines

    def append(self, entry: Mapping[str, Any]) -> None:
        """Write one entry."""
        self._lines.append(json.dumps(entry, allow_nan=False).encode())


@contextlib.contextmanager
def open_journal(path: Path) -> Iterator[Journal]:
    """Open a journal for appending; everything appended is on disk when the block ends. ServiceError when it cannot."""
    with open_lines(path, synced=True) as lines:
        yield Journal(lines)
