"""How long it takes from the capture of a bearing to what the stop monitor decided on it: a histogram."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.run_messages import Histogram
from drivers.clock import Clock
from gcs.traced_monitor import MonitorNote

BOUNDS_S: Final = (0.005, 0.01, 0.02, 0.03, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0)


@dataclass
class DecisionTimes:
    """Counts decisions by their age. `note` takes what monitors tell; it never fails."""

    clock: Clock
    _counts: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS_S) + 1))
    _sum_s: float = 0.0
    _captured_s: dict[str, float] = field(default_factory=dict)

    def note(self, receiver: str, note: MonitorNote) -> None:
        """Take in what a receiver's monitor was told or answered."""
        if note.observed is not None:
            self._captured_s[receiver] = note.time_s
        elif note.asked is not None and (captured_s := self._captured_s.pop(receiver, None)) is not None:
            age_s = max(self.clock.now_s() - captured_s, 0.0)
            self._counts[bisect_left(BOUNDS_S, age_s)] += 1
            self._sum_s += age_s

    def histogram(self) -> Histogram:
        """Return how many decisions were at most so old; the last count is of all."""
        counts, total = list[int](), 0
        for count in self._counts:
            total += count
            counts.append(total)
        return Histogram(list(BOUNDS_S), counts, self._sum_s)
