"""Two-circle positioning in closed form: three transmitters A, B, C and the two angles they subtend at the receiver D.

The angle that A and B subtend puts D on a circle through both, the angle of A and C on a second one, and the circles
meet in A and in D (eqs. 5 to 10). With A as origin, b = B - A, c = C - A and w = 1 / (D - A), the inversion, both
circles become lines:

    Im(b e^{-i alpha} w) = -sin alpha        Im(c e^{-i beta} w) = -sin beta

so that signed angles need one 2x2 solve, and unsigned angles one for each choice of signs. Points are complex numbers
in one plane, m; angles are rad.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.angles import subtended_angle, wrap
from planner.errors import PositioningError

ANGLE_TOLERANCE_RAD = 5e-4
"""How far unsigned angles may be off: enough for three of them rounded to 0.01 degree."""

_LEAST_CONDITIONING = 1e-6
_LEAST_RATIO = 1e-9
"""Distances from the receiver to two transmitters are in no greater proportion: nearer, it stands at one of them."""
_SIGNS = np.array([(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)])


@dataclass(frozen=True, eq=False)
class TwoCircleFixes:
    """Many fixes at once; the arrays share the broadcast shape of the arguments.

    `conditioning` is |det| / (|b||c|) = |sin(arg c - arg b + alpha - beta)| in [0, 1], and 0 on the circle (or line)
    through A, B, C. Where `valid` is False, `position` is that of A: finite, and not to be used.
    """

    position: NDArray[np.complex128]
    conditioning: NDArray[np.float64]
    valid: NDArray[np.bool_]


@np.errstate(over="ignore", invalid="ignore")
def two_circle(
    alpha: ArrayLike,
    beta: ArrayLike,
    a: ArrayLike,
    b: ArrayLike,
    c: ArrayLike,
    *,
    least_conditioning: float = _LEAST_CONDITIONING,
) -> TwoCircleFixes:
    """Return D from the signed angles alpha = subtended_angle(D, A, B) and beta = subtended_angle(D, A, C), rad.

    All arguments broadcast. A fix is valid when it is better conditioned than `least_conditioning`, when D sees B and C
    at these angles and not at their opposites (the forward check), and when D is at no transmitter and not at infinity.
    With angles of standard deviation sigma, linear covariance holds while the conditioning is well above sigma.
    """
    origin = np.asarray(a, dtype=np.complex128)
    to_b, to_c = np.asarray(b) - origin, np.asarray(c) - origin
    turn_b, turn_c = _unit(alpha), _unit(beta)
    u, v = to_b * turn_b, to_c * turn_c
    determinant, size = np.imag(u * np.conj(v)), np.abs(to_b) * np.abs(to_c)
    conditioning = np.abs(determinant) / np.where(size > 0.0, size, 1.0)
    solvable = conditioning > least_conditioning
    w = (np.imag(turn_b) * np.conj(v) - np.imag(turn_c) * np.conj(u)) / np.where(solvable, determinant, 1.0)

    length = np.abs(w) * np.maximum(np.abs(to_b), np.abs(to_c))
    placed = solvable & (length > _LEAST_RATIO) & (length < 1.0 / _LEAST_RATIO)
    ahead = np.minimum(np.real(turn_b - u * w), np.real(turn_c - v * w)) > _LEAST_RATIO
    valid = np.asarray(placed & ahead)
    position = np.where(valid, origin + 1.0 / np.where(valid, w, 1.0), origin)
    return TwoCircleFixes(position, np.nan_to_num(conditioning), valid)


def two_circle_candidates(alpha: float, beta: float, a: complex, b: complex, c: complex) -> tuple[complex, ...]:
    """Return every position that sees A and B at the unsigned angle alpha, and A and C at beta (eqs. 9 and 10).

    Up to four, one for each choice of signs that passes the forward check, without repetition. A choice that is
    degenerate has no candidate.
    """
    fixes = two_circle(_SIGNS[:, 0] * alpha, _SIGNS[:, 1] * beta, a, b, c)
    same_m = _LEAST_RATIO * (abs(b - a) + abs(c - a))
    distinct: list[complex] = []
    for position in fixes.position[fixes.valid].tolist():
        if all(abs(position - other) > same_m for other in distinct):
            distinct.append(position)
    return tuple(distinct)


def two_circle_unsigned(
    alpha: float,
    beta: float,
    a: complex,
    b: complex,
    c: complex,
    *,
    third_angle: float | None = None,
    prior: complex | None = None,
    tolerance_rad: float = ANGLE_TOLERANCE_RAD,
) -> complex:
    """Return the one position that fits the unsigned angles alpha (ADB), beta (ADC) and what else is known, rad.

    `third_angle` is the unsigned angle BDC: it drops the candidates that see it differently by more than
    `tolerance_rad`, and leaves two in most cases. `prior` is a rough position: the nearest candidate is taken.

    Raises PositioningError, naming the candidates, when none or more than one fits, when the angles fit any point of
    the circle (or line) through A, B and C, and when the receiver may stand at a transmitter.
    """
    alpha, beta = abs(wrap(alpha)), abs(wrap(beta))
    at_b, at_c = _angle(b, a, c), _angle(c, a, b)
    if _inscribed(alpha, at_c, tolerance_rad) and _inscribed(beta, at_b, tolerance_rad):
        raise PositioningError(
            f"every point of the circle (or line) through the transmitters at {a}, {b} and {c} sees them at these "
            "angles: use a transmitter that is not on it"
        )
    at_transmitter = [
        place for place, seen, angle in ((b, beta, at_b), (c, alpha, at_c)) if abs(seen - angle) < _LEAST_RATIO
    ]
    fitting = [
        candidate
        for candidate in two_circle_candidates(alpha, beta, a, b, c)
        if third_angle is None or abs(_angle(candidate, b, c) - abs(wrap(third_angle))) <= tolerance_rad
    ]
    return _resolve(fitting, at_transmitter, prior)


def relative_to_target(position: complex, a: complex, target: complex) -> tuple[float, float]:
    """Return the polar coordinates (r, theta) of a position about the target O, polar axis A-O, m and rad.

    This is r e^{i theta} = rho e^{i theta'} - rho_0, which eq. 11 means; theta is in (-pi, pi] and 0 where r = 0.
    Raises PositioningError when A and O coincide.
    """
    if target == a:
        raise PositioningError(f"the polar axis from A to the target is undefined: both are at {a}")
    axis = target - a
    r, theta = cmath.polar((position - target) * axis.conjugate())
    return r / abs(axis), theta


def _unit(angle: ArrayLike) -> NDArray[np.complex128]:
    """Return e^{-i angle}."""
    radians = np.asarray(angle, dtype=np.float64)
    turn = np.empty(radians.shape, dtype=np.complex128)
    turn.real, turn.imag = np.cos(radians), -np.sin(radians)
    return turn


def _angle(vertex: complex, first: complex, second: complex) -> float:
    return abs(float(subtended_angle(vertex, first, second)))


def _inscribed(angle: float, at_transmitter: float, tolerance_rad: float) -> bool:
    """Whether a point of the circle ABC can see a side at `angle` that the opposite transmitter sees at the other."""
    return min(abs(angle - at_transmitter), abs(math.pi - angle - at_transmitter)) <= tolerance_rad


def _resolve(fitting: list[complex], at_transmitter: list[complex], prior: complex | None) -> complex:
    """Return the only candidate, or the one nearest to the prior; PositioningError when there is no such one."""
    candidates = fitting + at_transmitter
    if not fitting:
        where = f", unless the receiver stands at the transmitter at {at_transmitter[0]}" if at_transmitter else ""
        raise PositioningError(f"no position fits the angles{where}: check them for multipath, or raise the tolerance")
    if prior is None and len(candidates) > 1:
        raise PositioningError(f"the angles fit {_listed(candidates)}: give the third angle or a prior position")
    if prior is not None:
        candidates.sort(key=lambda candidate: abs(candidate - prior))
        nearest_m = [abs(candidate - prior) for candidate in candidates[:2]]
        if nearest_m[-1] - nearest_m[0] <= _LEAST_RATIO * nearest_m[-1] and len(candidates) > 1:
            raise PositioningError(f"the prior {prior} lies as near to {_listed(candidates[:2])}: give another one")
    if candidates[0] in at_transmitter:
        raise PositioningError(f"the receiver stands at the transmitter at {candidates[0]}, where no angle is defined")
    return candidates[0]


def _listed(candidates: list[complex]) -> str:
    return " and ".join(f"{candidate:.6g}" for candidate in candidates)
