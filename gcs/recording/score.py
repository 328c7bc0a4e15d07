"""The score of a run, from the positions the vehicles tell: it judges the flight and never steers it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs.relay.records import ReceiverRecord
from gcs.relay.states import IN_FLIGHT
from gcs.safety import PositionBoard
from planner.frames import FormationFrame

_TRACK_SPACING_M = 0.2


@dataclass(frozen=True)
class _Run:
    """How far beyond the end of its latest leg a receiver was at the farthest, and is, along the leg, m."""

    leg_number: int
    farthest_m: float
    latest_m: float


@dataclass
class Score:
    """Flown lengths, tracks and separations. Tracks are in the formation frame, m."""

    frame: FormationFrame
    board: PositionBoard
    records: Mapping[str, ReceiverRecord]
    min_separation_m: float | None = None
    leg_lengths_m: dict[tuple[str, int], float] = field(default_factory=lambda: defaultdict(float))
    tracks: dict[str, list[complex]] = field(default_factory=lambda: defaultdict(list))
    _last: dict[str, complex] = field(default_factory=dict)
    _runs: dict[str, _Run] = field(default_factory=dict)

    def moved(self, name: str) -> None:
        """Take in the newest position of a vehicle from the board."""
        place = self.frame.from_site(self.board.latest[name].north_east)
        step_m = abs(place - self._last.get(name, place))
        self._last[name] = place
        record = self.records.get(name)
        if record is None:
            return
        if record.leg is not None:
            self.leg_lengths_m[name, len(record.legs) - 1] += step_m
        if record.state in IN_FLIGHT:
            self._note_run(record, place)
            self._note_separation(name)
            track = self.tracks[name]
            if not track or abs(place - track[-1]) >= _TRACK_SPACING_M:
                track.append(place)

    def placement_error_m(self, record: ReceiverRecord) -> float | None:
        """Return how far a receiver says it stands from its slot, m; None when it has told no position."""
        place = self._last.get(record.name)
        return None if place is None else abs(place - record.route.target)

    def overshoot_m(self, record: ReceiverRecord) -> float | None:
        """Return how far a receiver ran on its last leg beyond where it came to stand, m; None when it flew none."""
        run = self._runs.get(record.name)
        return None if run is None else max(0.0, run.farthest_m - run.latest_m)

    def _note_run(self, record: ReceiverRecord, place: complex) -> None:
        if not record.legs or record.legs[-1].leg.length_m == 0.0:
            return
        leg, number = record.legs[-1].leg, len(record.legs)
        way = leg.end - leg.start
        along_m = ((place - leg.end) / (way / abs(way))).real
        last = self._runs.get(record.name)
        farthest_m = along_m if last is None or last.leg_number != number else max(last.farthest_m, along_m)
        self._runs[record.name] = _Run(number, farthest_m, along_m)

    def _note_separation(self, name: str) -> None:
        nearest = self.board.smallest_separation_m(name)
        if nearest is not None:
            smallest = nearest[0] if self.min_separation_m is None else min(self.min_separation_m, nearest[0])
            self.min_separation_m = smallest
