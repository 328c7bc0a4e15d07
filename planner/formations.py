"""Formations: named slots in the formation frame, in relay order."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

from planner.errors import ProblemError

Slots = dict[str, complex]


def slot_name(number: int) -> str:
    """Return the paper's name of a slot: O1, O2, ..."""
    return f"O{number}"


def circle(count: int, radius_m: float) -> Slots:
    """Return `count` slots O1.. on the circle about L0, 360/(count + 1) degrees apart; L1 stands in slot 0.

    Raises ProblemError unless count >= 1 and the radius is positive and finite.
    """
    if count < 1 or not (0.0 < radius_m < math.inf):
        raise ProblemError(f"a circle needs at least one slot and a radius > 0 m, not {count} slots at {radius_m} m")
    step = math.tau / (count + 1)
    return {slot_name(k): cmath.rect(radius_m, k * step) for k in range(1, count + 1)}


def custom(points: Mapping[str, complex]) -> Slots:
    """Return the given points as slots, in the given order.

    Raises ProblemError when there is none or a coordinate is not finite.
    """
    if not points:
        raise ProblemError("a custom formation needs at least one slot")
    for name, point in points.items():
        if not cmath.isfinite(point):
            raise ProblemError(f"slot {name} lies at {point}: coordinates must be finite")
    return dict(points)
