"""Where a receiver is on its leg: an extended Kalman filter over measured directions, about the commanded motion.

A receiver holds a place, which the commands move (`response`). About that place it sways, as gusts and its own braking
make it, and from it it drifts, as one does that holds velocity and no position. The filter estimates by how much the
commanded motion is off, the sway and the drift. A direction is seen from where the receiver is, the held place plus
the sway; each transmitter stands where it is believed to, give or take. Every direction counts by itself: one that
lies does not take the others along.

Without north, directions are measured from the nose. Where it points is one thing more to estimate, which all
directions of a report share: the first report tells, and it is held from then on, give or take.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.relay.response import Agility, Response
from gcs.relay.rounding import Unrounded, unrounded
from gcs.relay.unrest import Nose, Unrest
from planner.angles import wrap

Reals = NDArray[np.float64]

OUTLIER_SIGMAS: Final = 5.0
_NEAREST_M: Final = 0.5
_INITIAL_SPEED_SIGMA_MPS: Final = 0.3
_DOUBT_M: Final = 0.1
_DOUBT_MPS: Final = 0.5
_TURNED: Final = 4
"""So many reports in a row in which fewer than two directions agree mean that the nose has turned."""
_ADAPTED_PER_BEARING: Final = 0.02
_ROUGHEST: Final = 200.0
_ANYWHERE_RAD: Final = 1.0
"""A standard deviation so wide that the first direction says alone where the nose points."""

_HELD, _SPEED, _SWAY, _DRIFT = slice(0, 2), slice(2, 4), slice(4, 6), slice(6, 8)
_NORTH, _YAW = 8, 9
_OWN: Final = 10
_ITS: Final = 4
_SEEN: Final = np.hstack([np.eye(2), np.zeros((2, 2)), np.eye(2)])
"""Where the receiver is, from (held, speed, sway)."""


@dataclass(frozen=True)
class Whereabouts:
    """A receiver on its leg: complex numbers, along the leg from its end and to the left of it, m, m/s."""

    time_s: float
    seen: complex
    """Where it is..."""
    at_rest: complex
    """...and would come to rest, told to stop now."""
    velocity: complex
    drift: complex
    sigma_m: float
    """Standard deviation of `at_rest` along the leg."""
    sway_m: float


@dataclass(frozen=True)
class _Sight:
    """One measured direction against the expected one: the surplus, rad, its gradient by the state, its variance.

    The variance is before the direction was rounded to the sensor's step, 0: to none.
    """

    surplus_rad: float
    gradient: Reals
    crossed: Reals
    variance: float
    step_rad: float

    @property
    def sigmas(self) -> float:
        return max(abs(self.surplus_rad) - self.step_rad / 2.0, 0.0) / math.sqrt(self.variance)

    @property
    def news(self) -> Unrounded | None:
        if not self.step_rad:
            return Unrounded(self.surplus_rad, 0.0, self.sigmas**2)
        return unrounded(self.surplus_rad, self.variance, self.step_rad)


class LegFilter:
    """Follows one receiver along `course`, a unit vector, to `end`; points in the formation frame, m.

    `covariance`, m^2, shape (2, 2), is of the located `start`; `place_sigma_m` of the transmitters' places, per axis,
    nothing said: exact. `nose` is what directions are measured from; None: they are measured from north.
    """

    def __init__(
        self,
        end: complex,
        course: complex,
        transmitters: Mapping[str, complex],
        place_sigma_m: Mapping[str, float],
        start: complex,
        covariance: Reals,
        time_s: float,
        agility: Agility,
        unrest: Unrest,
        nose: Nose | None,
    ) -> None:
        self._end, self._course, self._unrest, self._nose = end, course, unrest, nose
        self._north_known = nose is None
        self._transmitters = dict(transmitters)
        self._place_sigma_m = dict(place_sigma_m)
        self._index: dict[str, int] = {}
        self._response = Response(agility, time_s, (start - end) / course)
        self._time_s = time_s
        self._roughness = 1.0
        """By how much the variance of every sway exceeds that of calm air."""
        self._within_sigmas, self._step_rad = OUTLIER_SIGMAS, 0.0
        self.disagreed = 0
        """In how many reports in a row fewer than two directions have agreed."""
        self.searched = False
        """Whether the last report had to tell where the nose points."""
        self._state = np.zeros(_OWN)
        sigmas = [0.0, _INITIAL_SPEED_SIGMA_MPS, unrest.sway_m, unrest.drift_mps]
        variances = [sigma**2 for sigma in (*np.repeat(sigmas, 2), 0.0, 0.0)]
        self._covariance: Reals = np.diag(variances)
        self._axes = np.array([[course.real, -course.imag], [course.imag, course.real]])
        self._covariance[_HELD, _HELD] = self._axes.T @ covariance @ self._axes

    def commanded(self, time_s: float, velocity: complex) -> None:
        """Note the velocity commanded from `time_s` on, m/s, along the course and to its left."""
        self._response.commanded(time_s, velocity)

    def observe(
        self,
        captured_s: float,
        directions_rad: Mapping[str, float],
        sigma_rad: Mapping[str, float],
        within_sigmas: float = OUTLIER_SIGMAS,
        resolution_rad: float = 0.0,
    ) -> frozenset[str]:
        """Take in the directions of one instant, polar, and return the transmitters whose directions agree.

        All of them must be known. Those agree that are `within_sigmas` standard deviations of what is expected, beside
        what rounding to the `resolution_rad` does to them.
        """
        self._within_sigmas, self._step_rad = within_sigmas, resolution_rad
        if captured_s > self._time_s:
            self._carry_on(captured_s)
        for name in directions_rad:
            if name not in self._index:
                self._add(name)
        searched = self.searched = not self._north_known
        if searched and len(directions_rad) < 2:
            return frozenset()
        ordered = self._find_north(directions_rad, sigma_rad) if searched else list(directions_rad)
        plausible = [name for name in ordered if self._agrees(name, directions_rad, sigma_rad)]
        agreeing = frozenset(name for name in plausible if self._take(name, directions_rad, sigma_rad))
        enough = len(agreeing) > 1 or (not searched and len(agreeing) == len(directions_rad))
        self.disagreed = 0 if enough else self.disagreed + 1
        if self._nose is not None:
            self._north_known = enough or (not searched and self.disagreed < _TURNED)
        return agreeing

    def widen(self) -> None:
        """Become less sure of where the receiver is and how fast, by what a report may have missed."""
        self._covariance[_HELD, _HELD] += np.eye(2) * _DOUBT_M**2
        self._covariance[_SPEED, _SPEED] += np.eye(2) * _DOUBT_MPS**2

    @property
    def speed_mps(self) -> float:
        """How fast the receiver should have moved at the last report, by what was commanded."""
        return abs(self._response.velocity)

    def whereabouts(self, now_s: float) -> Whereabouts:
        """Return where the receiver is by `now_s`: from the last report on as commanded."""
        now_s = max(now_s, self._time_s)
        response, step_s = self._response.later(now_s), now_s - self._time_s
        carried = self._unrest.transition(step_s)
        state = carried @ self._state[:_NORTH]
        held, speed, sway, drift = (complex(*state[part]) for part in (_HELD, _SPEED, _SWAY, _DRIFT))
        return Whereabouts(
            time_s=now_s,
            seen=response.place + response.overshoot + held + sway,
            at_rest=self._response.at_rest(now_s) + held + self._unrest.speed_s * speed,
            velocity=response.velocity + speed + drift,
            drift=drift,
            sigma_m=math.sqrt(max(float(carried[0] @ self._covariance[:_NORTH, :_NORTH] @ carried[0]), 0.0)),
            sway_m=self._unrest.sway_m * math.sqrt(self._roughness),
        )

    def place(self) -> tuple[complex, Reals]:
        """Return where the receiver was at the last report, formation frame, m, and its covariance, m^2."""
        covariance = _SEEN @ self._covariance[:6, :6] @ _SEEN.T
        return self._end + self._course * self._seen(), self._axes @ covariance @ self._axes.T

    def standing_place(self) -> tuple[complex, Reals]:
        """Return where it will stand once it has come to rest, formation frame, m, and the covariance, m^2."""
        at_rest = self.whereabouts(self._time_s).at_rest
        return self._end + self._course * at_rest, self._axes @ self._covariance[_HELD, _HELD] @ self._axes.T

    def commanded_place(self) -> complex:
        """Return where commands alone should have brought it by the last report, formation frame, m."""
        return self._end + self._course * (self._response.place + self._response.overshoot)

    def _add(self, name: str) -> None:
        """Let the state hold a transmitter that is heard for the first time: where it stands, and its sway."""
        size = self._index[name] = self._state.size
        self._state = np.concatenate([self._state, np.zeros(_ITS)])
        covariance = np.zeros((size + _ITS, size + _ITS))
        covariance[:size, :size] = self._covariance
        sway = self._roughness * self._unrest.sway_m**2
        place = self._place_sigma_m.get(name, 0.0) ** 2
        covariance[range(size, size + _ITS), range(size, size + _ITS)] = place, place, sway, sway
        self._covariance = covariance

    def _find_north(self, directions_rad: Mapping[str, float], sigma_rad: Mapping[str, float]) -> list[str]:
        """Take the nose to point where most directions say; return them with those first that say so most clearly."""
        unknown = [_NORTH, _YAW]
        self._state[unknown] = 0.0
        self._covariance[unknown, :] = self._covariance[:, unknown] = 0.0
        sights = {name: self._sight(name, direction, sigma_rad[name]) for name, direction in directions_rad.items()}

        def apart(one: str, other: str) -> float:
            """Return by how much two directions contradict each other, in standard deviations."""
            off_rad = wrap(sights[one].surplus_rad - sights[other].surplus_rad)
            variance = sights[one].variance + sights[other].variance + self._step_rad**2 / 6.0
            return min(abs(off_rad) / math.sqrt(variance), OUTLIER_SIGMAS)

        middle = min(sights, key=lambda name: sum(apart(name, other) for other in sights))
        self._state[_NORTH] = sights[middle].surplus_rad
        self._covariance[_NORTH, _NORTH] = _ANYWHERE_RAD**2
        if self._nose is not None:
            self._covariance[_YAW, _YAW] = self._roughness * self._nose.yaw_rad**2
        return sorted(sights, key=lambda name: apart(name, middle))

    def _seen(self) -> complex:
        return self._response.place + self._response.overshoot + complex(*(self._state[_HELD] + self._state[_SWAY]))

    def _agrees(self, name: str, directions_rad: Mapping[str, float], sigma_rad: Mapping[str, float]) -> bool:
        return self._sight(name, directions_rad[name], sigma_rad[name]).sigmas <= self._within_sigmas

    def _take(self, name: str, directions_rad: Mapping[str, float], sigma_rad: Mapping[str, float]) -> bool:
        """Correct the state by one direction; False when it does not agree with those taken before."""
        sight = self._sight(name, directions_rad[name], sigma_rad[name])
        if sight.sigmas > self._within_sigmas:
            return False
        news = sight.news
        if news is None:
            return True
        gain = sight.crossed / sight.variance
        self._state = self._state + gain * news.mean
        kept = np.eye(self._state.size) - np.outer(gain, sight.gradient)
        noise = sigma_rad[name] ** 2 + news.variance
        self._covariance = kept @ self._covariance @ kept.T + np.outer(gain, gain) * noise
        adapted = self._roughness * (1.0 + _ADAPTED_PER_BEARING * (news.surprise - 1.0))
        self._roughness = max(1.0, min(adapted, _ROUGHEST))
        return True

    def _sight(self, name: str, direction_rad: float, sigma_rad: float) -> _Sight:
        first = self._index[name]
        placed, swayed = slice(first, first + 2), slice(first + 2, first + _ITS)
        stands = self._transmitters[name] + complex(*(self._state[placed] + self._state[swayed]))
        towards = stands - self._end - self._course * self._seen()
        towards = towards if abs(towards) > _NEAREST_M else complex(_NEAREST_M)
        by_own, by_its = -self._course / towards, 1.0 / towards
        gradient = np.zeros(self._state.size)
        gradient[_HELD] = gradient[_SWAY] = by_own.imag, by_own.real
        gradient[[_NORTH, _YAW]] = 1.0
        gradient[placed] = gradient[swayed] = by_its.imag, by_its.real
        surplus_rad = wrap(direction_rad - cmath.phase(towards) - float(self._state[_NORTH] + self._state[_YAW]))
        crossed = self._covariance @ gradient
        variance = float(gradient @ crossed) + sigma_rad**2
        return _Sight(surplus_rad, gradient, crossed, variance, self._step_rad)

    def _carry_on(self, to_s: float) -> None:
        unrest, step_s, before = self._unrest, to_s - self._time_s, self._response.velocity
        unanswered_mps = self._response.unanswered_mps
        self._response.advance(to_s)
        unanswered_mps = max(unanswered_mps, self._response.unanswered_mps)
        acceleration_mps2 = abs(self._response.velocity - before) / step_s
        transition = np.eye(self._state.size)
        transition[:_NORTH, :_NORTH] = unrest.transition(step_s)
        for first in self._index.values():
            transition[[first + 2, first + 3], [first + 2, first + 3]] = math.exp(-step_s / unrest.sway_s)
        if self._nose is not None:
            transition[_YAW, _YAW] = math.exp(-step_s / self._nose.yaw_s)
        self._state = transition @ self._state
        self._covariance = transition @ self._covariance @ transition.T
        added = unrest.added(step_s, self._roughness, unanswered_mps, acceleration_mps2)
        self._covariance[np.arange(_NORTH), np.arange(_NORTH)] += added
        sway = unrest.swayed_m2(step_s, self._roughness)
        for first in self._index.values():
            swayed = [first + 2, first + 3]
            self._covariance[swayed, swayed] += sway
        if self._nose is not None:
            yaw = self._nose.yawed_rad2(step_s, self._roughness)
            self._covariance[[_NORTH, _YAW], [_NORTH, _YAW]] += self._nose.wander_rad**2 * step_s, yaw
        self._time_s = to_s
