"""The time series of a run, and which legs and stops were announced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from drivers.clock import Clock
from gcs.faults.kept.missing import LOST_S, Missing
from gcs.recording.lines import open_lines
from gcs.recording.series import SAMPLE_S, LegBegun, LegEnded, Series, read_line
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import ReceiverState
from gcs.safety import PositionBoard
from gcs.status import RunStatus
from planner.frames import FormationFrame

_LEGS: Final = frozenset({ReceiverState.LEG_1, ReceiverState.LEG_2, ReceiverState.TRIMMING})
_STOPPED: Final = frozenset({ReceiverState.LEG_2, ReceiverState.VERIFYING})
_AT_ONCE_S: Final = 0.01


@dataclass(frozen=True)
class _Event:
    """A leg that began or ended by its stop condition."""

    time_s: float
    receiver: str
    ended: bool

    def is_of(self, other: _Event) -> bool:
        alike = (self.receiver, self.ended) == (other.receiver, other.ended)
        return alike and abs(self.time_s - other.time_s) < _AT_ONCE_S

    def __str__(self) -> str:
        return f"the {'stop' if self.ended else 'leg'} at {self.time_s:.3f} s"


class KeptSeries:
    """series.jsonl, sampled as the service samples it."""

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        records: Mapping[str, ReceiverRecord],
        board: PositionBoard,
        frame: FormationFrame,
    ) -> None:
        self._path, self._clock = folder / "series.jsonl", clock
        self._opened = ExitStack()
        lines = self._opened.enter_context(open_lines(self._path, synced=False))
        self._series = Series(lines, RunStatus("", clock, records=records), board, frame, clock)
        self._due_s = clock.now_s()
        self._zero_ns = clock.unix_ns() - round(clock.now_s() * 1e9)
        self._states: dict[str, ReceiverState] = {}
        self._given: list[_Event] = []

    def announced(self, record: ReceiverRecord) -> None:
        """See which legs begin and end."""
        before, state = self._states.get(record.name), record.state
        self._states[record.name] = state
        if state is before:
            return
        if before in _LEGS and state in _STOPPED:
            self._given.append(_Event(self._clock.now_s(), record.name, ended=True))
        if state in _LEGS:
            self._given.append(_Event(self._clock.now_s(), record.name, ended=False))

    def look(self) -> None:
        """Sample when it is time to."""
        if self._clock.now_s() >= self._due_s:
            self._due_s = self._clock.now_s() + SAMPLE_S
            self._series.sample()

    def close(self, missing: Missing, killed_s: float) -> None:
        """Read it back: every leg and every stop has to be there, but those just before the service was killed."""
        self._opened.close()
        read = list(self._read())
        for given in self._given:
            found = next((event for event in read if event.is_of(given)), None)
            if found is not None:
                read.remove(found)
            elif given.time_s < killed_s - LOST_S - SAMPLE_S:
                missing(given.receiver, f"series.jsonl: {given} is not in it")
        for event in read:
            missing(event.receiver, f"series.jsonl: {event} is in it, and nobody told of it")

    def _read(self) -> Iterator[_Event]:
        for text in self._path.read_bytes().splitlines():
            line = read_line(text)
            if isinstance(line, LegBegun | LegEnded):
                time_s = (line.time_ns - self._zero_ns) * 1e-9
                yield _Event(time_s, line.receiver, ended=isinstance(line, LegEnded))
