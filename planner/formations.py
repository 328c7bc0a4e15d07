"""Formations: named slots in relay order; L0 stands at the origin, L1 on the positive x axis."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable, Mapping

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


def line(count: int, spacing_m: float, direction_rad: float = math.pi / 2) -> Slots:
    """Return `count` slots in a line from L0 (itself not a slot); by default across the axis L0-L1."""
    _require("a line", count, spacing_m)
    return _named(cmath.rect(k * spacing_m, direction_rad) for k in range(1, count + 1))


def echelon(count: int, spacing_m: float, sweep_rad: float = math.pi / 4) -> Slots:
    """Return `count` slots behind L0 on its left, `sweep_rad` off the axis that points from L1 back to L0."""
    _require("an echelon", count, spacing_m)
    return _named(cmath.rect(k * spacing_m, math.pi - sweep_rad) for k in range(1, count + 1))


def vee(count: int, spacing_m: float, sweep_rad: float = math.pi / 4) -> Slots:
    """Return `count` slots on two wings behind L0, left and right in turn, each `sweep_rad` off the axis."""
    _require("a vee", count, spacing_m)
    return _named(
        cmath.rect((k // 2 + 1) * spacing_m, math.pi + (sweep_rad if k % 2 else -sweep_rad)) for k in range(count)
    )


def grid(count: int, spacing_m: float, columns: int | None = None) -> Slots:
    """Return `count` slots in rows parallel to the axis, the first row one spacing to the left of it.

    Rows have `columns` slots, by default as many as make the grid nearly square; L0 is below the first column.
    """
    _require("a grid", count, spacing_m)
    wide = columns if columns is not None else math.isqrt(count - 1) + 1
    if wide < 1:
        raise ProblemError(f"a grid needs at least one column, not {wide}")
    return _named(spacing_m * complex(k % wide, k // wide + 1) for k in range(count))


def polygon(count: int, radius_m: float, sides: int = 6) -> Slots:
    """Return `count` slots evenly along a regular polygon about L0, whose first corner, at `radius_m`, is L1's."""
    _require("a polygon", count, radius_m)
    if sides < 3:
        raise ProblemError(f"a polygon needs three sides, not {sides}")
    corners = [cmath.rect(radius_m, k * math.tau / sides) for k in range(sides + 1)]
    slots: list[complex] = []
    for k in range(1, count + 1):
        side, numerator = divmod(k * sides, count + 1)
        slots.append(corners[side] + (corners[side + 1] - corners[side]) * numerator / (count + 1))
    return _named(slots)


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


def transformed(
    slots: Mapping[str, complex], *, scale: float = 1.0, rotation_rad: float = 0.0, mirrored: bool = False
) -> Slots:
    """Return the slots mirrored on the axis L0-L1, then rotated about L0, counter-clockwise, and scaled.

    Raises ProblemError unless the scale is positive and finite.
    """
    if not 0.0 < scale < math.inf:
        raise ProblemError(f"a formation can be scaled by a positive number, not {scale}")
    turn = cmath.rect(scale, rotation_rad)
    return {name: turn * (point.conjugate() if mirrored else point) for name, point in slots.items()}


FORMATIONS: dict[str, Callable[[int, float], Slots]] = {
    "circle": circle,
    "line": line,
    "echelon": echelon,
    "vee": vee,
    "grid": grid,
    "polygon": polygon,
}
"""Formations by name: how many slots, and the radius or spacing, m."""


def _require(what: str, count: int, size_m: float) -> None:
    if count < 1 or not (0.0 < size_m < math.inf):
        raise ProblemError(f"{what} needs at least one slot and a size > 0 m, not {count} slots at {size_m} m")


def _named(points: Iterable[complex]) -> Slots:
    return {slot_name(k): point for k, point in enumerate(points, start=1)}
