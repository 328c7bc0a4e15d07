"""The journal: every state change of a run, one JSON line each, synced to disk before the next is written.

What a line knows beyond its words stands under `known`: with it another service goes on where this one ended.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import logging
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ServiceError
from gcs.recording.lines import LineFile, Tell, open_lines
from gcs.relay.records import ReceiverRecord
from planner.plan import RelayPlan, plan_to_json

log = logging.getLogger(__name__)

FILE: Final = "journal.jsonl"


class Journal:
    """Append-only; entries come out in the order they were appended."""

    def __init__(self, lines: LineFile) -> None:
        self._lines = lines

    def append(self, entry: Mapping[str, Any]) -> None:
        """Write one entry."""
        self._lines.append(json.dumps(entry, allow_nan=False).encode())


@contextlib.contextmanager
def open_journal(path: Path, say: Tell | None = None) -> Iterator[Journal]:
    """Open a journal for appending; everything appended is on disk when the block ends.

    `say` is told on the event loop when it cannot be written any more. ServiceError when it cannot be opened, or while
    another process has it open: a run is flown by one.
    """
    with open_lines(path, synced=True, say=say) as lines, _alone(path):
        yield Journal(lines)


def change_line(time_ns: int, record: ReceiverRecord) -> dict[str, Any]:
    """Return the entry of a receiver's change."""
    return {
        "time_ns": time_ns,
        "receiver": record.name,
        "slot": record.route.slot,
        "state": record.state.value,
        "reason": record.reason,
        "known": {
            "place_m": None if record.place is None else [record.place.real, record.place.imag],
            "covariance_m2": _written(record.covariance),
            "route": plan_to_json(RelayPlan("", (record.route,), 0.0, 0.0, 0.0))["receivers"][0],
        },
    }


def relay_line(
    time_ns: int, text: str, taken: Collection[str] | None, given_up: Collection[str] | None
) -> dict[str, Any]:
    """Return the entry of what concerns the run as a whole, with who is the pilots' and who is done without.

    None where there is no relay that could tell: what an earlier entry said of them holds.
    """
    entry: dict[str, Any] = {"time_ns": time_ns, "relay": text}
    if taken is not None and given_up is not None:
        entry["known"] = {"taken": sorted(taken), "given_up": sorted(given_up)}
    return entry


def _written(covariance: NDArray[np.float64] | None) -> list[list[float]] | None:
    """Return a covariance as JSON has it; one that is not finite says nothing."""
    return None if covariance is None or not np.isfinite(covariance).all() else covariance.tolist()


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Keep other processes from the file while the block lasts; the lock goes with the process, however it ends."""
    if not path.is_file():
        yield
        return
    with path.open("rb") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ServiceError(f"{path} is being written by another process: its service is still running") from error
        except OSError as error:
            log.warning("%s cannot be locked (%s): see that no other service flies this run", path, error)
        yield
