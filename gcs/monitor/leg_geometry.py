"""The subtended angle along a leg: how fast it changes, and how much of it the end of the leg allows."""

from __future__ import annotations

from dataclasses import dataclass

from planner.angles import direction, wrap
from planner.plan import Leg

_STEP_M = 0.05


@dataclass(frozen=True)
class LegGeometry:
    """A leg and where the two transmitters of its stop reference stand, formation frame, m."""

    leg: Leg
    first: complex
    second: complex

    @property
    def course(self) -> complex:
        """The unit vector from start to end; 0 for a leg without length."""
        along = self.leg.end - self.leg.start
        return along / abs(along) if along else 0j

    def angle_rad(self, at: complex) -> float:
        """Return the subtended angle seen from a place, rad."""
        return wrap(direction(self.second - at) - direction(self.first - at))

    def gradient_radpm(self, at: complex) -> float:
        """Return by how much the subtended angle changes per metre along the leg, rad/m."""
        step = _STEP_M * self.course
        return wrap(self.angle_rad(at + step) - self.angle_rad(at - step)) / (2.0 * _STEP_M)

    def at(self, remaining_m: float, cross_track_m: float) -> complex:
        """Return the place so far from the end along the leg, and to its left, formation frame, m."""
        return self.leg.end + complex(-remaining_m, cross_track_m) * self.course
