"""Whether a vehicle follows what it is told, by where bearings find it: one that does not is in nobody's hands here."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

OVER_S: Final = 6.0
"""What was told and what was flown are compared over this: no vehicle and no link takes half as long to answer..."""
_FOLLOWED_SHARE: Final = 0.5
"""...and one that came less than this share of its way has not."""
_CREEP_MPS: Final = 0.6
"""Who falls short by less than this for all the time follows: PX4's own velocity can be wrong by up to 0.5 m/s for so
long, as that of a simulated one whose estimator took its gyroscope for better than it was: told 0.4 m/s, it stood."""
_LEAST_M: Final = 1.0
"""A way shorter than this has no direction to speak of."""
_SURE_SIGMAS: Final = 5.0


@dataclass(frozen=True)
class _Mark:
    time_s: float
    commanded: complex
    found: complex
    sigma_m: float


@dataclass
class Following:
    """Compares the way that commands should have brought a vehicle with the way it came."""

    lost: bool = False
    """Whether it has not followed lately."""
    _marks: deque[_Mark] = field(default_factory=deque)

    def begin(self) -> None:
        """Begin anew: nothing counts that was before."""
        self.lost = False
        self._marks.clear()

    def note(self, time_s: float, commanded: complex, found: complex, sigma_m: float) -> None:
        """Note where commands alone should have brought it, and where bearings find it, give or take; m on any axes."""
        now, marks = _Mark(time_s, commanded, found, sigma_m), self._marks
        marks.append(now)
        while len(marks) > 1 and marks[1].time_s <= time_s - OVER_S:
            marks.popleft()
        then = marks[0]
        way, come = now.commanded - then.commanded, now.found - then.found
        told_m, sigma_m = abs(way), max(then.sigma_m, now.sigma_m)
        if told_m >= _LEAST_M and then.time_s <= time_s - OVER_S:
            short_m = told_m - (come * way.conjugate()).real / told_m
            crept_m = _CREEP_MPS * (time_s - then.time_s)
            self.lost = short_m > max((1.0 - _FOLLOWED_SHARE) * told_m, crept_m, _SURE_SIGMAS * sigma_m)
