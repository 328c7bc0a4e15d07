"""The paper's end of a leg, to compare with: constant speed, and a stop at the first raw sample that is near enough.

Algorithm 1 flies while |alpha' - alpha| > epsilon. Its epsilon of 1e-6 rad is met by no bearing that is sampled and
noisy: here it is twice the standard deviation of a measured angle, and who is past the angle stops as well. Nothing
that flies real vehicles can choose this.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from planner.angles import wrap
from planner.plan import Leg

EPSILON_SIGMAS: Final = 2.0
_ONTO_LINE: Final = 3.0
"""How much farther than the guide's bearing is off the course turns: it closes on the line of bearing."""
_LARGEST_TURN_RAD: Final = math.radians(30.0)


@dataclass(frozen=True)
class RawStop:
    """Ends one leg by each report alone. `transmitters` are where they are taken to stand, formation frame, m."""

    leg: Leg
    transmitters: Mapping[str, complex]
    course: complex = field(init=False)
    """The leg's direction, a unit vector."""
    _before_rad: float = field(init=False)
    """How far the angle is from the stop angle at the planned start."""

    def __post_init__(self) -> None:
        towards = self.transmitters[self.leg.guide] - self.leg.end
        towards *= 1.0 if self.leg.direction == "towards" else -1.0
        first, second = (self.transmitters[name] - self.leg.start for name in self.leg.stop_reference)
        object.__setattr__(self, "course", towards / abs(towards))
        object.__setattr__(self, "_before_rad", wrap(cmath.phase(second / first) - self.leg.stop_angle_rad))

    def usable(self, directions_rad: Mapping[str, float]) -> bool:
        """Return whether a report has all directions that the leg needs."""
        return directions_rad.keys() >= {self.leg.guide, *self.leg.stop_reference}

    def reached(self, directions_rad: Mapping[str, float], sigma_rad: Mapping[str, float]) -> bool:
        """Return whether the angle of this report is near enough to the stop angle, or past it."""
        first, second = self.leg.stop_reference
        off_rad = wrap(directions_rad[second] - directions_rad[first] - self.leg.stop_angle_rad)
        epsilon_rad = EPSILON_SIGMAS * math.hypot(sigma_rad[first], sigma_rad[second])
        past = off_rad * self._before_rad <= 0.0 and abs(off_rad) < math.pi / 2.0
        return past or abs(off_rad) <= epsilon_rad

    def velocity(self, guide_rad: float | None, speed_mps: float) -> complex:
        """Return the velocity to command, formation frame, m/s: along the guide's line of bearing, and onto it.

        `guide_rad` is the guide's direction from north, polar; None: it is not known, and the course is kept.
        """
        if guide_rad is None:
            return speed_mps * self.course
        towards = self.leg.direction == "towards"
        line_rad = cmath.phase(self.course if towards else -self.course)
        turn_rad = (_ONTO_LINE if towards else -_ONTO_LINE) * wrap(guide_rad - line_rad)
        turn_rad = max(-_LARGEST_TURN_RAD, min(_LARGEST_TURN_RAD, turn_rad))
        return self.course * cmath.rect(speed_mps, turn_rad)
