"""What may be wrong with the bearing reports of one receiver, and how many were."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final, Literal

from drivers.bus.messages import LEAST_SIGMA_RAD, BearingReport
from gcs.clock_offsets import CaptureTime

STUCK_AFTER: Final = 3
"""So many reports with the same azimuths to the last bit, from a sensor that has noise, are no measurements."""

_AHEAD_S: Final = 0.02
"""How far from the future a report may seem to come beside what is known of its clock: clocks are read in between."""
_REMEMBERED: Final = 16

Problem = Literal[
    "stale", "from_the_future", "duplicate", "out_of_order", "malformed", "unknown_sender", "without_heading", "stuck"
]
TIMING: Final[frozenset[Problem]] = frozenset({"stale", "from_the_future", "out_of_order"})
"""What a clock that has just been set looks like."""


@dataclass
class BearingCounters:
    """What became of bearing reports: how many came, and how many of them were dropped for what."""

    received: int = 0
    stale: int = 0
    from_the_future: int = 0
    duplicate: int = 0
    out_of_order: int = 0
    malformed: int = 0
    unknown_sender: int = 0
    without_heading: int = 0
    stuck: int = 0

    def count(self, problem: Problem) -> None:
        """Count one report that is dropped."""
        setattr(self, problem, getattr(self, problem) + 1)

    def add(self, others: BearingCounters) -> None:
        """Add what others counted."""
        for name, value in vars(others).items():
            setattr(self, name, getattr(self, name) + value)


@dataclass
class ReportChecks:
    """The checks of one receiver's reports, in the order they come; reports over `max_age_s` are stale."""

    max_age_s: float
    counters: BearingCounters = field(default_factory=BearingCounters)
    _last_captured_ns: int = field(default=-1, init=False)
    _times_set: int = field(default=0, init=False)
    _seen: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_REMEMBERED), init=False)
    _azimuths_rad: tuple[float, ...] = field(default=(), init=False)
    _repeats: int = field(default=0, init=False)

    def problem(self, report: BearingReport, captured: CaptureTime) -> Problem | None:
        """Return what is wrong with one report as a measurement of its instant, or None."""
        if len({bearing.transmitter for bearing in report.bearings}) < len(report.bearings):
            return "malformed"  # two bearings of one transmitter: which one is it?
        if (report.captured_ns, report.sequence) in self._seen:
            return "duplicate"
        self._seen.append((report.captured_ns, report.sequence))
        return self._untimely(report, captured) or ("stuck" if self._repeats_itself(report) else None)

    def _untimely(self, report: BearingReport, captured: CaptureTime) -> Problem | None:
        latest_s = earliest_s = self.max_age_s
        if captured.clock_uncertainty_s is not None:
            latest_s -= captured.clock_uncertainty_s
            blur_s = captured.clock_uncertainty_s + report.captured_uncertainty_ns * 1e-9
            earliest_s = min(earliest_s, blur_s + _AHEAD_S)
        if captured.age_s > latest_s:
            return "stale"
        if captured.age_s < -earliest_s:
            return "from_the_future"
        if captured.times_set == self._times_set and report.captured_ns <= self._last_captured_ns:
            return "out_of_order"
        self._last_captured_ns, self._times_set = report.captured_ns, captured.times_set
        return None

    def _repeats_itself(self, report: BearingReport) -> bool:
        """Return whether a sensor that has noise shows what it showed before, once more than chance would have it."""
        azimuths_rad = tuple([bearing.azimuth_rad for bearing in report.bearings])
        self._repeats = self._repeats + 1 if azimuths_rad and azimuths_rad == self._azimuths_rad else 0
        self._azimuths_rad = azimuths_rad
        if self._repeats < STUCK_AFTER - 1 or report.resolution_rad > 0.0:
            return False
        return any(bearing.sigma_rad > LEAST_SIGMA_RAD for bearing in report.bearings)
