"""What the paper compares its method with, as far as its words go: a reconstruction, not the authors' code.

* Geometric optimisation (section 3.3): gradient descent on the squared sum of angle errors, the UAV moving along. The
  paper gives no step rule, so none is fitted to its numbers: each step goes straight down the gradient to the least
  squared error the linearised angles promise (Cauchy's step), halved until the error really falls.
* Trilateration (section 2.1, figure 3): the position at three known distances from three known points. From angles,
  the points and distances are centres and radii of the circles on which two transmitters are seen under one angle.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.angles import subtended_angle, wrap_all
from planner.dilution import COINCIDENT_RATIO, bearing_gradients
from planner.errors import PositioningError, ProblemError

_ENOUGH_DESCENT = 1e-4
_MAX_HALVINGS = 40
_LEAST_SINE = 1e-9

_Floats = NDArray[np.float64]
_Points = NDArray[np.complex128]


@dataclass(frozen=True)
class Descent:
    """How a receiver moved: every place it stood at, m, and the root of the squared angle error left, rad."""

    places: tuple[complex, ...]
    error_rad: float
    converged: bool

    @property
    def steps(self) -> int:
        """How often it measured and moved: the paper's k."""
        return len(self.places) - 1

    @property
    def length_m(self) -> float:
        """Sum of the steps, m."""
        return sum(abs(end - begin) for begin, end in pairwise(self.places))


def geometric_optimisation(
    start: complex,
    target: complex,
    transmitters: tuple[complex, ...],
    *,
    heading_referenced: bool = True,
    tolerance_rad: float = 1e-4,
    max_steps: int = 1000,
) -> Descent:
    """Return the descent from `start` until the transmitters are seen as from `target`, m.

    Seen are their bearings, or without a heading reference the angles between them; two transmitters fix a place only
    by bearings. It has converged when the angle error is within the tolerance; it also ends where the error falls no
    further, and after `max_steps`. Raises ProblemError with fewer than two transmitters, a place that is not finite,
    and a target at a transmitter.
    """
    stations = np.array(transmitters, dtype=np.complex128)
    _require_problem(start, target, stations)
    places = [start]
    for _ in range(max_steps):
        following = _step(places[-1], target, stations, heading_referenced, tolerance_rad)
        if following is None:
            break
        places.append(following)
    square, _ = squared_angle_error(places[-1], target, stations, heading_referenced=heading_referenced)
    return Descent(tuple(places), math.sqrt(square), math.sqrt(square) <= tolerance_rad)


def _require_problem(start: complex, target: complex, transmitters: _Points) -> None:
    if transmitters.size < 2:
        raise ProblemError(f"two transmitters fix a place, {transmitters.size} do not")
    places = np.array([start, target, *transmitters])
    if not np.isfinite(places).all():
        raise ProblemError(f"one of {places} is no place: coordinates must be finite")
    if (np.abs(transmitters - target) <= COINCIDENT_RATIO * np.abs(places - target).max()).any():
        raise ProblemError(f"the target {target} is at a transmitter, which has no bearing there")


def squared_angle_error(
    at: complex, target: complex, transmitters: _Points, *, heading_referenced: bool
) -> tuple[float, complex]:
    """Return the squared sum of angle errors, rad^2, and its gradient (x + iy), rad^2/m."""
    error, gradients = _errors(at, target, transmitters, heading_referenced)
    return float(error @ error), complex(2.0 * (gradients @ error))


def _errors(at: complex, target: complex, transmitters: _Points, heading_referenced: bool) -> tuple[_Floats, _Points]:
    """Return the error of each angle, rad, and its gradient, 1/m."""
    error = wrap_all(np.angle(transmitters - at) - np.angle(transmitters - target))
    gradients = bearing_gradients(at, transmitters)
    if heading_referenced:
        return error, gradients
    first, second = np.triu_indices(transmitters.size, 1)
    return wrap_all(error[second] - error[first]), np.asarray(gradients[second] - gradients[first])


def _step(
    at: complex, target: complex, transmitters: _Points, heading_referenced: bool, tolerance_rad: float
) -> complex | None:
    """Return the next place; None when the error is within the tolerance or falls no further."""
    error, gradients = _errors(at, target, transmitters, heading_referenced)
    square, downhill = float(error @ error), complex(-2.0 * (gradients @ error))
    if square <= tolerance_rad**2 or downhill == 0.0:
        return None
    heading = downhill / abs(downhill)
    turned = np.real(gradients * heading.conjugate())
    step_m = min(abs(downhill) / (2.0 * float(turned @ turned)), float(np.abs(transmitters - at).max()))
    for _ in range(_MAX_HALVINGS):
        following = at + step_m * heading
        reached, _ = squared_angle_error(following, target, transmitters, heading_referenced=heading_referenced)
        if reached < square - _ENOUGH_DESCENT * step_m * abs(downhill):
            return following
        step_m /= 2.0
    return None


def trilateration(alpha: float, beta: float, gamma: float, a: complex, b: complex, c: complex) -> complex:
    """Return D from the three signed angles ADB, ADC and BDC, rad, each measured by itself, m.

    Each angle puts D on a circle through two transmitters; subtracting the circles' equations from one another leaves
    two lines. Raises PositioningError where a circle is a line (D in line with two transmitters, which two-circle
    positioning solves) and where the centres are in line (D on the circle through A, B and C).
    """
    circles = [_circle(*pair) for pair in ((alpha, a, b), (beta, a, c), (gamma, b, c))]
    (first, first_m), (second, second_m), (third, third_m) = circles
    u, v = second - first, third - first
    determinant = (u.conjugate() * v).imag
    if abs(determinant) <= _LEAST_SINE * (first_m**2 + second_m**2 + third_m**2):
        raise PositioningError(f"the receiver is on the circle through {a}, {b} and {c}: use another transmitter")
    along_u = (first_m**2 - second_m**2 + abs(u) ** 2) / 2.0
    along_v = (first_m**2 - third_m**2 + abs(v) ** 2) / 2.0
    return first + 1j * (along_v * u - along_u * v) / determinant


def _circle(angle: float, first: complex, second: complex) -> tuple[complex, float]:
    """Return centre and radius of the circle on which two points are seen at this signed angle (eqs. 5 and 6), m."""
    sine = math.sin(angle)
    if abs(sine) <= _LEAST_SINE or first == second:
        raise PositioningError(f"the receiver is in line with {first} and {second}: their circle is a line")
    to_centre = (second - first) * 1j * cmath.rect(1.0, -angle) / (2.0 * sine)
    return first + to_centre, abs(to_centre)


def trilateration_angles(at: complex, a: complex, b: complex, c: complex) -> tuple[float, float, float]:
    """Return the angles `trilateration` takes, as a receiver at `at` would measure them exactly, rad."""
    alpha, beta, gamma = (float(subtended_angle(at, *pair)) for pair in ((a, b), (a, c), (b, c)))
    return alpha, beta, gamma
