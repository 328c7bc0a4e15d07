"""Whether a sensor that repeats itself is stuck, or only shows directions in steps that turn slowly.

A sensor without steps never shows the same twice from a receiver under way. One with steps does until a direction has
turned by a step, and then it is given half a step more: whatever has not changed by then will not.
"""

from __future__ import annotations

import cmath
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

STEPS_UNCHANGED: Final = 1.5
"""By so many steps any direction may have turned, by what was commanded, before one of them shows that."""


@dataclass
class Repetition:
    """Looks at the reports of one receiver. `transmitters` are the places of all it may hear, m on any axes."""

    transmitters: Mapping[str, complex]
    stuck: bool = False
    """Whether the last report was the one before once more, and could not be.

    With steps that lasts until a report is another: at a stand-still nothing tells that it has passed.
    """
    _last: dict[str, float] = field(default_factory=dict)
    _changed_at: complex | None = None
    """Where the receiver was when a report was last another, or when it last was not under way."""

    def begin(self) -> None:
        """Begin to fly, perhaps not for the first time: the sensor is given another chance."""
        self.stuck, self._changed_at = False, None

    def note(self, directions_rad: dict[str, float], resolution_rad: float, place: complex, *, under_way: bool) -> None:
        """Note a report, in steps of `resolution_rad` or 0, and where commands alone have brought the receiver."""
        repeated = len(directions_rad) > 1 and directions_rad == self._last
        self._last = directions_rad
        if self._changed_at is None or not (repeated and under_way):
            self._changed_at = place
        turned_rad = self._turned_rad(directions_rad, self._changed_at, place)
        still_stuck = repeated and self.stuck and resolution_rad > 0.0
        self.stuck = still_stuck or (repeated and under_way and turned_rad >= STEPS_UNCHANGED * resolution_rad)

    def _turned_rad(self, names: Mapping[str, float], then: complex, now: complex) -> float:
        """Return by how much the direction has turned that has turned most, on the way from one place to another."""
        if then == now:
            return 0.0
        sights = ((self.transmitters[name] - now, self.transmitters[name] - then) for name in names)
        return max((abs(cmath.phase(sight * before.conjugate())) for sight, before in sights), default=0.0)
