"""The predicted 3-sigma error ellipses of a plan, magnified where they would be too small to see.

In an SVG their group ids are `ellipse-turning-1-U1` and `ellipse-slot-O1`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from numpy.typing import NDArray

from gcs.reports.canvas import Style
from planner.plan import RelayPlan
from planner.relay_accuracy import PlacementAccuracy

_COLOUR = "#CC79A7"
_FACTORS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_TYPICAL, _LARGEST = 0.03, 0.12
"""How large a semi-axis may get, in parts of the field's longer side."""


@dataclass(frozen=True)
class ErrorEllipse:
    """Semi-axes of three sigma, m, the longer first, and the polar angle of the longer one, rad."""

    gid: str
    at: complex
    semi_axes_m: tuple[float, float]
    turned_rad: float


def ellipses_of(plan: RelayPlan, accuracy: Mapping[str, PlacementAccuracy]) -> list[ErrorEllipse]:
    """Return the ellipses at every turning point and in every slot, of the receivers whose accuracy is given."""
    return [_ellipse(gid, at, covariance) for gid, at, covariance in _covariances(plan, accuracy) if covariance.any()]


def _covariances(
    plan: RelayPlan, accuracy: Mapping[str, PlacementAccuracy]
) -> Iterator[tuple[str, complex, NDArray[np.float64]]]:
    for route in plan.routes:
        predicted = accuracy.get(route.receiver)
        if predicted is None:
            continue
        for number, (leg, covariance) in enumerate(zip(route.legs[:-1], predicted.leg_ends, strict=False), 1):
            yield f"ellipse-turning-{number}-{route.receiver}", leg.end, covariance
        yield f"ellipse-slot-{route.slot}", route.target, predicted.slot


def _ellipse(gid: str, at: complex, covariance: NDArray[np.float64]) -> ErrorEllipse:
    values, vectors = np.linalg.eigh(covariance)
    shorter_m, longer_m = (3.0 * math.sqrt(max(float(value), 0.0)) for value in values)
    return ErrorEllipse(gid, at, (longer_m, shorter_m), math.atan2(vectors[1, 1], vectors[0, 1]))


def magnification(ellipses: Sequence[ErrorEllipse], side_m: float) -> int:
    """Return how much larger than true the ellipses are best drawn on a field with this longer side, m."""
    longer_m = np.array([ellipse.semi_axes_m[0] for ellipse in ellipses])
    fitting = [
        factor
        for factor in _FACTORS
        if factor * np.median(longer_m) <= _TYPICAL * side_m and factor * longer_m.max() <= _LARGEST * side_m
    ]
    return max(fitting, default=1)


def draw_ellipses(axes: Axes, ellipses: Sequence[ErrorEllipse], factor: int) -> Line2D:
    """Draw the ellipses so magnified; return their entry in the legend."""
    for ellipse in ellipses:
        width_m, height_m = (2.0 * factor * semi_axis for semi_axis in ellipse.semi_axes_m)
        patch = Ellipse((ellipse.at.real, ellipse.at.imag), width_m, height_m, angle=math.degrees(ellipse.turned_rad))
        in_slot = ellipse.gid.startswith("ellipse-slot")
        patch.set(facecolor=(_COLOUR, 0.35 if in_slot else 0.12), edgecolor=_COLOUR, linewidth=0.9, zorder=2)
        patch.set_gid(ellipse.gid)
        axes.add_patch(patch)
    name = "3-sigma error" if factor == 1 else f"3-sigma error ({factor} times true size)"
    style: Style = {"marker": "o", "markersize": 11, "markerfacecolor": (_COLOUR, 0.35), "markeredgecolor": _COLOUR}
    return Line2D([], [], label=name, linestyle="none", **style)
