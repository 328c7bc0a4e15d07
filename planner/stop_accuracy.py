"""How accurately a leg ends, and which pair of transmitters ends it best.

With g_q(x) the gradient of the direction from x to transmitter q, e the error of the receiver, eps_q that of q, n the
normal of the leg and G its guide, everything is linear in the errors and the noise:

* stop: g_C1.(e - eps_C1) - g_C2.(e - eps_C2) = noise of variance 2 sigma^2 / k;
* line, only differences of bearings known: n.e = n.eps_G + lambda n.(e_start - eps_G), lambda = rho_end / rho_start;
* line, bearings north-referenced: n.e = n.eps_G + rho_end times noise of variance sigma^2 / k.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.accuracy import Indices, LegLine, PositionError, Reals, RelayErrors, bearing_gradient, vector

_BLIND_GRADIENT = 1e-12
_LARGEST_TURN_RAD = 0.07
"""Up to this standard deviation of where the leg begins, as seen from its guide, the linear model is trusted."""
_REGARD_ALONG = 0.2
"""What a square metre along leg 1 weighs against one that reaches the slot: the linear model holds for small errors."""


@dataclass(frozen=True)
class Stop:
    """How a leg ends: its stop reference (station indices), and the error it leaves."""

    leg: LegLine
    reference: tuple[int, int]
    error: PositionError
    dependable: bool
    """Whether a linear model holds: not where the leg begins so near its guide that it may begin beyond it."""


@dataclass(frozen=True)
class _Line:
    """The error across the leg's line at its end: its variance, and its covariance with every station, (K, 2)."""

    variance: float
    shared: Reals


@dataclass(frozen=True)
class _Pairs:
    """All pairs of transmitters as stop references of one leg; arrays of shape (pairs,).

    `slope` and `tilt` are how the angle changes along the leg and across it; `across` is the covariance of the errors
    across and along the leg at its end, `ahead` the variance along it.
    """

    first: Indices
    second: Indices
    slope: Reals
    tilt: Reals
    across: Reals
    ahead: Reals


def best_stop(
    errors: RelayErrors, error: PositionError, leg: LegLine, candidates: Indices, following: LegLine | None = None
) -> Stop | None:
    """Return how `leg` is best stopped, by a pair of the `candidates`; None when no pair tells its end.

    `error` is the receiver's where the leg begins. The best pair leaves the least variance along the worst axis; or,
    when the error at the leg's end shifts the `following` leg sideways, the least shift, with some regard to the error
    along the leg.
    """
    line = _line(errors, error, leg)
    gradient = bearing_gradient(leg.end, errors.stations[candidates])
    pairs = _pairs(errors, leg, candidates, gradient, line)
    if not pairs.slope.size:
        return None
    if following is None or errors.noise.heading_referenced:
        half_trace = (line.variance + pairs.ahead) / 2.0
        spread = half_trace + np.hypot((line.variance - pairs.ahead) / 2.0, pairs.across)
    else:
        spread = _shift(errors, leg, following, candidates, gradient, pairs, line)
    best = int(np.argmin(spread))

    one, other = pairs.first[best], pairs.second[best]
    c1, c2 = int(candidates[one]), int(candidates[other])
    angle_shared = np.einsum("a,ajb->jb", gradient[one], errors.covariance[c1])
    angle_shared = angle_shared - np.einsum("a,ajb->jb", gradient[other], errors.covariance[c2])
    ahead_shared = (angle_shared - pairs.tilt[best] * line.shared) / pairs.slope[best]
    normal, along, across = vector(leg.direction * 1j), vector(leg.direction), pairs.across[best]
    axes = np.stack([normal, along])
    own = axes.T @ np.array([[line.variance, across], [across, pairs.ahead[best]]]) @ axes
    shared = normal[:, None, None] * line.shared + along[:, None, None] * ahead_shared
    return Stop(leg, (c1, c2), PositionError(own, shared), _dependable(errors, error, leg))


def _line(errors: RelayErrors, error: PositionError, leg: LegLine) -> _Line:
    normal = vector(leg.direction * 1j)
    guide_shared = np.einsum("a,ajb->jb", normal, errors.covariance[leg.guide])
    guide_variance = float(guide_shared[leg.guide] @ normal)
    if errors.noise.heading_referenced:
        from_guide_m = float(abs(leg.end - errors.stations[leg.guide]))
        return _Line(guide_variance + from_guide_m**2 * errors.noise.bearing_variance, guide_shared)
    kept = _kept(errors, leg)
    own_shared = np.einsum("a,ajb->jb", normal, error.shared)
    variance = (
        (1.0 - kept) ** 2 * guide_variance
        + 2.0 * kept * (1.0 - kept) * float(own_shared[leg.guide] @ normal)
        + kept**2 * float(normal @ error.own @ normal)
    )
    return _Line(variance, (1.0 - kept) * guide_shared + kept * own_shared)


def _dependable(errors: RelayErrors, error: PositionError, leg: LegLine) -> bool:
    """Return whether the guide is far off for what is unknown of the leg's begin against it."""
    if errors.noise.heading_referenced:
        return True
    from_guide_m = float(abs(leg.begin - errors.stations[leg.guide]))
    worst_axis_m = math.sqrt(max(float(np.linalg.eigvalsh(errors.apart(error, leg.guide))[-1]), 0.0))
    return worst_axis_m <= _LARGEST_TURN_RAD * from_guide_m


def _kept(errors: RelayErrors, leg: LegLine) -> float:
    """Return lambda: how much of the error across the line at the leg's begin is left at its end."""
    guide = errors.stations[leg.guide]
    return float(abs(leg.end - guide) / abs(leg.begin - guide))


def _pairs(errors: RelayErrors, leg: LegLine, candidates: Indices, gradient: Reals, line: _Line) -> _Pairs:
    moved = np.einsum("ia,iajb,jb->ij", gradient, errors.among(candidates), gradient)
    line_moved = np.einsum("ja,ja->j", line.shared[candidates], gradient)
    first, second = np.triu_indices(candidates.size, 1)
    difference = gradient[first] - gradient[second]
    told = np.abs(difference @ vector(leg.direction)) > _BLIND_GRADIENT
    first, second, difference = first[told], second[told], difference[told]
    slope, tilt = difference @ vector(leg.direction), difference @ vector(leg.direction * 1j)
    variance = moved[first, first] + moved[second, second] - 2.0 * moved[first, second]
    variance = variance + 2.0 * errors.noise.bearing_variance
    together = line_moved[first] - line_moved[second]
    across = (together - tilt * line.variance) / slope
    ahead = (variance - 2.0 * tilt * together + tilt**2 * line.variance) / slope**2
    return _Pairs(first, second, slope, tilt, across, ahead)


def _shift(
    errors: RelayErrors,
    leg: LegLine,
    following: LegLine,
    candidates: Indices,
    gradient: Reals,
    pairs: _Pairs,
    line: _Line,
) -> Reals:
    """Return the variance across the following leg's line at its end, by each pair."""
    guide, across, kept = following.guide, vector(following.direction * 1j), _kept(errors, following)
    by_line, by_along = across @ vector(leg.direction * 1j), across @ vector(leg.direction)
    own = by_line**2 * line.variance + 2.0 * by_line * by_along * pairs.across + by_along**2 * pairs.ahead
    moved = np.einsum("ja,jab,b->j", gradient, errors.covariance[candidates, :, guide], across)
    line_moved = line.shared[guide] @ across
    ahead_moved = (moved[pairs.first] - moved[pairs.second] - pairs.tilt * line_moved) / pairs.slope
    together = by_line * line_moved + by_along * ahead_moved
    fixed = float(across @ errors.covariance[guide, :, guide] @ across)
    shift = kept**2 * own + 2.0 * kept * (1.0 - kept) * together + (1.0 - kept) ** 2 * fixed
    return np.asarray(shift + _REGARD_ALONG * pairs.ahead)
