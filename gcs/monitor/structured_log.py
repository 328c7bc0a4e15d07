"""The structured log of a run: a JSON object a line, with the vehicle, its leg and state where a line is about one.

What the run says and what the program logs go into one file, in order; one thread of its own writes it.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import msgspec

from gcs.recording.lines import LineFile, open_lines
from gcs.status import RunStatus, Said

FILE: Final = "service.jsonl"
_LOGGERS: Final = ("gcs", "drivers", "planner")
_LEVELS: Final = {"info": "INFO", "warning": "WARNING", "alert": "ERROR"}


class LogLine(msgspec.Struct, frozen=True, omit_defaults=True):
    """One line. `elapsed_s` is since the run began, by its own clock; lines of the program itself have none."""

    time: str
    level: str
    logger: str
    message: str
    elapsed_s: float | None = None
    vehicle: str | None = None
    leg: int | None = None
    state: str | None = None
    exception: str | None = None


@contextlib.contextmanager
def structured_log(folder: Path, status: RunStatus) -> Iterator[None]:
    """Write the log of a run into its folder while the block lasts. ServiceError when the file cannot be opened."""
    with open_lines(folder / FILE, synced=False) as lines:
        handler = _Handler(lines)

        def take(said: Said) -> None:
            line = LogLine(
                _rfc3339(time.time()),
                _LEVELS[said.level],
                "run",
                said.text,
                elapsed_s=round(said.elapsed_s, 3),
                vehicle=said.vehicle,
                leg=said.leg,
                state=said.state,
            )
            lines.append(msgspec.json.encode(line))

        for name in _LOGGERS:
            logging.getLogger(name).addHandler(handler)
        status.on_said.append(take)
        try:
            yield
        finally:
            status.on_said.remove(take)
            for name in _LOGGERS:
                logging.getLogger(name).removeHandler(handler)


class _Handler(logging.Handler):
    """Passes on what the program logs; `extra={"vehicle": ..., "leg": ...}` fills the fields of that name."""

    def __init__(self, lines: LineFile) -> None:
        super().__init__()
        self._lines = lines
        self._formatter = logging.Formatter()

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._lines.append(msgspec.json.encode(self._line(record)))
        except Exception:  # noqa: BLE001 - as logging does: a log that fails ends nothing
            self.handleError(record)

    def _line(self, record: logging.LogRecord) -> LogLine:
        beside: dict[str, Any] = vars(record)
        trouble = None if record.exc_info is None else self._formatter.formatException(record.exc_info)
        return LogLine(
            _rfc3339(record.created),
            record.levelname,
            record.name,
            record.getMessage(),
            vehicle=beside.get("vehicle"),
            leg=beside.get("leg"),
            exception=trouble,
        )


def _rfc3339(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
