"""How far from its slot a receiver stops: covariance of a stop, carried along the relay.

Every error is linear in independent sources: the noise of each stop and of each line of bearing, and the error of each
located start. A placed UAV transmits from where it stands, not from where its slot is, so its error moves the lines and
angles of all that follow. The joint covariance of all standing transmitters therefore is what the relay hands on.

With g_q(x) the gradient of the direction from x to transmitter q, e the error of the receiver, eps_q that of q, n the
normal of the leg and G its guide:

* stop: g_C1.(e - eps_C1) - g_C2.(e - eps_C2) = noise of variance 2 sigma^2 / k;
* line, only differences of bearings known: n.e = n.eps_G + lambda n.(e_start - eps_G), lambda = rho_end / rho_start;
* line, bearings north-referenced: n.e = n.eps_G + rho_end times noise of variance sigma^2 / k.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.routes import Points

Reals = NDArray[np.float64]
Indices = NDArray[np.intp]

_BLIND_GRADIENT = 1e-12
_LARGEST_TURN_RAD = 0.07
_REGARD_ALONG = 0.2
"""What a square metre along leg 1 weighs against one that reaches the slot: the linear model holds for small errors."""


@dataclass(frozen=True)
class BearingNoise:
    """What the sensor and the first location are worth."""

    bearing_sigma_rad: float
    samples: int
    start_sigma_m: float
    heading_referenced: bool

    @property
    def bearing_variance(self) -> float:
        """Variance of one averaged bearing, rad^2."""
        return self.bearing_sigma_rad**2 / self.samples


@dataclass(frozen=True)
class PositionError:
    """Error of one receiver: its covariance, shape (2, 2), and its covariance with every station, shape (2, K, 2)."""

    own: Reals
    shared: Reals

    @property
    def worst_axis_3sigma_m(self) -> float:
        """Three sigma along the worst axis, m."""
        return 3.0 * math.sqrt(max(float(np.linalg.eigvalsh(self.own)[-1]), 0.0))


@dataclass(frozen=True)
class LegLine:
    """A leg as geometry: the station that guides it, where it begins and where it ends."""

    guide: int
    begin: complex
    end: complex

    @property
    def direction(self) -> complex:
        """Unit vector along the leg."""
        return (self.end - self.begin) / abs(self.end - self.begin)


@dataclass(frozen=True)
class Stop:
    """How a leg ends: its stop reference (station indices), and the error it leaves."""

    leg: LegLine
    reference: tuple[int, int]
    error: PositionError
    dependable: bool
    """Whether a linear model holds: not with a guide so near that it stands in the error's ellipse."""


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


class RelayErrors:
    """The joint error of all stations that stand: the first transmitters, exact, and every receiver placed since.

    `stations` are the places of all transmitters and slots, shape (K,), metres.
    """

    def __init__(self, stations: Points, noise: BearingNoise) -> None:
        self._stations = stations
        self._noise = noise
        self._covariance = np.zeros((stations.size, 2, stations.size, 2))

    def copy(self) -> RelayErrors:
        """Return an independent copy."""
        copied = RelayErrors.__new__(RelayErrors)
        copied._stations, copied._noise, copied._covariance = self._stations, self._noise, self._covariance.copy()
        return copied

    def at_start(self) -> PositionError:
        """Return the error of a receiver that has just been located."""
        return PositionError(np.eye(2) * self._noise.start_sigma_m**2, np.zeros((2, self._stations.size, 2)))

    def place(self, station: int, error: PositionError) -> None:
        """Let a receiver with this error stand at `station` from now on."""
        self._covariance[station] = error.shared
        self._covariance[:, :, station] = np.moveaxis(error.shared, 0, -1)
        self._covariance[station, :, station] = error.own

    def stop(
        self, error: PositionError, leg: LegLine, candidates: Indices, following: LegLine | None = None
    ) -> Stop | None:
        """Return how `leg` is best stopped, by a pair of the `candidates`; None when no pair tells its end.

        The best pair leaves the least variance along the worst axis; or, when the error at the leg's end shifts the
        `following` leg sideways, the least shift, with some regard to the error along the leg.
        """
        normal, along = _vector(leg.direction * 1j), _vector(leg.direction)
        line_variance, line_shared, turned = self._line(error, leg)
        gradient = bearing_gradient(leg.end, self._stations[candidates])
        pairs = self._pairs(leg, candidates, gradient, line_variance, line_shared, turned)
        if not pairs.slope.size:
            return None
        if following is None or self._noise.heading_referenced:
            half_trace = (line_variance + pairs.ahead) / 2.0
            spread = half_trace + np.hypot((line_variance - pairs.ahead) / 2.0, pairs.across)
        else:
            spread = self._shift(leg, following, candidates, gradient, pairs, line_variance, line_shared)
        best = int(np.argmin(spread))

        one, other = pairs.first[best], pairs.second[best]
        c1, c2 = int(candidates[one]), int(candidates[other])
        angle_shared = np.einsum("a,ajb->jb", gradient[one], self._covariance[c1])
        angle_shared = angle_shared - np.einsum("a,ajb->jb", gradient[other], self._covariance[c2])
        ahead_shared = (angle_shared - pairs.tilt[best] * line_shared) / pairs.slope[best]
        axes, across = np.stack([normal, along]), pairs.across[best]
        own = axes.T @ np.array([[line_variance, across], [across, pairs.ahead[best]]]) @ axes
        shared = normal[:, None, None] * line_shared + along[:, None, None] * ahead_shared
        return Stop(leg, (c1, c2), PositionError(own, shared), self._dependable(error, leg))

    def _line(self, error: PositionError, leg: LegLine) -> tuple[float, Reals, float]:
        """Return the variance across the line at the leg's end, its covariances (K, 2), its direction's variance."""
        normal = _vector(leg.direction * 1j)
        guide_shared = np.einsum("a,ajb->jb", normal, self._covariance[leg.guide])
        guide_variance = float(guide_shared[leg.guide] @ normal)
        if self._noise.heading_referenced:
            turned_m = abs(leg.end - self._stations[leg.guide])
            noise = self._noise.bearing_variance
            return guide_variance + float(turned_m**2) * noise, guide_shared, noise
        kept = self._kept(leg)
        own_shared = np.einsum("a,ajb->jb", normal, error.shared)
        variance = (
            (1.0 - kept) ** 2 * guide_variance
            + 2.0 * kept * (1.0 - kept) * float(own_shared[leg.guide] @ normal)
            + kept**2 * float(normal @ error.own @ normal)
        )
        apart = self._apart(error, leg)
        along = _vector(leg.direction)
        turned = float(normal @ apart @ normal) / float(abs(leg.begin - self._stations[leg.guide]) ** 2)
        bent = kept**2 * turned * float(along @ apart @ along)
        return variance + bent, (1.0 - kept) * guide_shared + kept * own_shared, turned

    def _among(self, stations: Indices) -> Reals:
        """Return the covariances among some stations, shape (t, 2, t, 2)."""
        return self._covariance[stations][:, :, stations]

    def _dependable(self, error: PositionError, leg: LegLine) -> bool:
        """Return whether the guide is far off for what is unknown of the leg's begin against it."""
        if self._noise.heading_referenced:
            return True
        from_guide_m = float(abs(leg.begin - self._stations[leg.guide]))
        return math.sqrt(float(np.linalg.eigvalsh(self._apart(error, leg))[-1])) <= _LARGEST_TURN_RAD * from_guide_m

    def _apart(self, error: PositionError, leg: LegLine) -> Reals:
        """Return the covariance of the error at the leg's begin relative to the guide's."""
        shared = error.shared[:, leg.guide]
        return np.asarray(error.own - shared - shared.T + self._covariance[leg.guide, :, leg.guide])

    def _kept(self, leg: LegLine) -> float:
        """Return lambda: how much of the error across the line at the leg's begin is left at its end."""
        guide = self._stations[leg.guide]
        return float(abs(leg.end - guide) / abs(leg.begin - guide))

    def _pairs(
        self,
        leg: LegLine,
        candidates: Indices,
        gradient: Reals,
        line_variance: float,
        line_shared: Reals,
        turned: float,
    ) -> _Pairs:
        block = self._among(candidates)
        moved = np.einsum("ia,iajb,jb->ij", gradient, block, gradient)
        line_moved = np.einsum("ja,ja->j", line_shared[candidates], gradient)
        first, second = np.triu_indices(candidates.size, 1)
        difference = gradient[first] - gradient[second]
        told = np.abs(difference @ _vector(leg.direction)) > _BLIND_GRADIENT
        first, second, difference = first[told], second[told], difference[told]
        slope, tilt = difference @ _vector(leg.direction), difference @ _vector(leg.direction * 1j)
        variance = moved[first, first] + moved[second, second] - 2.0 * moved[first, second]
        variance = variance + 2.0 * self._noise.bearing_variance
        together = line_moved[first] - line_moved[second]
        across = (together - tilt * line_variance) / slope
        ahead = (variance - 2.0 * tilt * together + tilt**2 * line_variance) / slope**2
        return _Pairs(first, second, slope, tilt, across, ahead * (1.0 + 3.0 * turned * (tilt / slope) ** 2))

    def _shift(
        self,
        leg: LegLine,
        following: LegLine,
        candidates: Indices,
        gradient: Reals,
        pairs: _Pairs,
        line_variance: float,
        line_shared: Reals,
    ) -> Reals:
        """Return the variance across the following leg's line at its end, by each pair."""
        guide = following.guide
        guide_error = self._covariance[guide, :, guide]

        def variance(of: Reals, error: float, guide_part: float) -> Reals:
            by_line, by_along = of @ _vector(leg.direction * 1j), of @ _vector(leg.direction)
            own = by_line**2 * line_variance + 2.0 * by_line * by_along * pairs.across + by_along**2 * pairs.ahead
            moved = np.einsum("ja,jab,b->j", gradient, self._covariance[candidates, :, guide], of)
            line_moved = line_shared[guide] @ of
            ahead_moved = (moved[pairs.first] - moved[pairs.second] - pairs.tilt * line_moved) / pairs.slope
            together = by_line * line_moved + by_along * ahead_moved
            fixed = guide_part**2 * float(of @ guide_error @ of)
            return np.asarray(error**2 * own + 2.0 * error * guide_part * together + fixed)

        across, along = _vector(following.direction * 1j), _vector(following.direction)
        kept = self._kept(following)
        bent = variance(across, kept, -kept) * variance(along, 1.0, -1.0)
        bent = bent / float(abs(following.begin - self._stations[guide]) ** 2)
        return variance(across, kept, 1.0 - kept) + bent + _REGARD_ALONG * pairs.ahead

    def trim(self, error: PositionError, at: complex, transmitters: Indices) -> tuple[PositionError, Reals]:
        """Return the error after the maximum-a-posteriori trim leg, and the trim's gain, shape (2, t).

        The receiver standing near `at` measures the bearings of the t transmitters once more, estimates its error with
        the predicted covariance as the prior, and moves back by the estimate: gain times the bearings' surplus
        (measured minus planned direction, rad, counter-clockwise). Without a north reference the gain is blind to
        what all bearings have in common. The variance never grows.
        """
        gradient = bearing_gradient(at, self._stations[transmitters])
        block = self._among(transmitters)
        own_moved = np.einsum("ajb,jb->aj", error.shared[:, transmitters], gradient)
        with_error = error.own @ gradient.T - own_moved
        moved = np.einsum("ia,iajb,jb->ij", gradient, block, gradient)
        crossed = gradient @ own_moved
        spread = gradient @ error.own @ gradient.T - crossed - crossed.T + moved
        spread = spread + self._noise.bearing_variance * np.eye(transmitters.size)
        seen = np.eye(transmitters.size) if self._noise.heading_referenced else _differences(transmitters.size)
        gain = with_error @ seen.T @ np.linalg.pinv(seen @ spread @ seen.T, hermitian=True) @ seen
        shared_moved = np.einsum("ia,aKb->iKb", gradient, error.shared)
        shared_moved = shared_moved - np.einsum("ia,iaKb->iKb", gradient, self._covariance[transmitters])
        own = error.own - gain @ with_error.T
        return PositionError((own + own.T) / 2.0, error.shared - np.einsum("ai,iKb->aKb", gain, shared_moved)), gain


def bearing_gradient(at: ArrayLike, transmitters: ArrayLike) -> Reals:
    """Return how the direction from `at` to each transmitter turns as `at` moves, rad/m, last axis (x, y).

    Arguments broadcast and must not coincide.
    """
    offset = np.asarray(transmitters, dtype=np.complex128) - np.asarray(at, dtype=np.complex128)
    turned = 1j * offset / np.abs(offset) ** 2
    return -np.stack([turned.real, turned.imag], axis=-1)


def _differences(count: int) -> Reals:
    """Return the matrix that takes what all bearings have in common away."""
    return np.eye(count) - 1.0 / count


def _vector(point: complex) -> Reals:
    return np.array([point.real, point.imag])
