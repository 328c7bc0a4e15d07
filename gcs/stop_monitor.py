"""The stop-condition monitor of one leg: bearings in, stop decisions out. No position ever enters it.

The leg is a line through its guide. Where the receiver is on it is described by the distance to go s and the
cross-track error e (positive to the left), so that its place is E - u s + i u e with E the leg's end and u the unit
vector of flight. An extended Kalman filter follows (s, e) and their rates from two measured angles: the subtended
angle of the stop reference, which gives s, and the direction of the guide, which gives e. Between reports it carries
on with what was commanded, as the vehicle answers to commands.

The leg ends when the filtered s, which is zero where the subtended angle equals the stop angle, has stayed within a
band for a dwell: never on one sample.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.angles import wrap
from planner.plan import Leg

COMMAND_DELAY_S: Final = 0.24
"""From a setpoint to the first motion, as measured on ArduCopter."""
RESPONSE_TIME_S: Final = 0.5
"""Time constant with which the speed then follows."""
HOVER_NOISE: Final = 0.15
SPEED_NOISE_PER_MPS: Final = 0.1
"""How far the true motion strays from that, m/s per square root of a second: in hover, and more with each m/s."""
_INITIAL_SPEED_SIGMA_MPS: Final = 0.3

OUTLIER_SIGMAS: Final = 5.0
_DOUBT: Final = np.diag([0.1**2, 0.1**2, 0.5**2, 0.5**2])
"""What each outlier adds to the covariance, m^2 and m^2/s^2: reports that keep agreeing with each other win."""
_NEAREST_M: Final = 0.5
_NEAR_M: Final = 1.5
_PATIENCE_S: Final = 8.0
"""A vehicle that flies what it is told comes from near to arrived in less."""
_WIDENING_MPS: Final = 0.1
_COMMANDS_KEPT: Final = 50

State = NDArray[np.float64]
"""(s, e, rate of progress, rate of e): m and m/s; the rate of progress is positive while s shrinks."""


@dataclass(frozen=True)
class ArrivalRule:
    """When a leg counts as ended: how near, for how long, and whether it must also be on its line.

    The band is never narrower than what the filter can tell; staying within it for the dwell is being slow.
    """

    band_m: float
    dwell_s: float
    on_line: bool
    widest_m: float = 0.0
    """What the band widens to for a vehicle that has been near for a while and does not hold still better."""


TURN = ArrivalRule(band_m=0.3, dwell_s=0.3, on_line=False, widest_m=0.6)
"""For a leg whose end is a turning point: the next leg takes out what is left."""
SLOT = ArrivalRule(band_m=0.1, dwell_s=1.0, on_line=True, widest_m=0.6)
"""For the leg that ends in the slot."""


@dataclass(frozen=True)
class LegEstimate:
    """Where the receiver is on its leg, from angles alone."""

    remaining_m: float
    cross_track_m: float
    progress_mps: float
    remaining_sigma_m: float


@dataclass
class StopMonitor:
    """Follows one leg. `transmitters` are the known places of its guide and stop reference, formation frame, m.

    `start` and `start_covariance` (m^2) are the receiver's located place, `time_s` when it was there.
    """

    leg: Leg
    transmitters: Mapping[str, complex]
    start: complex
    start_covariance: NDArray[np.float64]
    time_s: float
    rule: ArrivalRule
    outliers: int = 0
    _state: State = field(init=False)
    _covariance: NDArray[np.float64] = field(init=False)
    _commands: deque[tuple[float, float, float]] = field(
        default_factory=lambda: deque(maxlen=_COMMANDS_KEPT), init=False
    )
    _within_since_s: float | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        towards_guide = self.transmitters[self.leg.guide] - self.leg.end
        self.course = towards_guide / abs(towards_guide) * (1.0 if self.leg.direction == "towards" else -1.0)
        offset = (self.start - self.leg.end) / self.course
        self._state = np.array([-offset.real, offset.imag, 0.0, 0.0])
        to_leg = _leg_axes(self.course).T
        self._covariance = np.diag([0.0, 0.0, _INITIAL_SPEED_SIGMA_MPS**2, _INITIAL_SPEED_SIGMA_MPS**2])
        self._covariance[:2, :2] = to_leg @ self.start_covariance @ to_leg.T
        self._state_time_s = self._near_since_s = self.time_s

    def commanded(self, time_s: float, along_mps: float, across_mps: float) -> None:
        """Note the velocity commanded from `time_s` on: along the leg, and to its left."""
        self._commands.append((time_s, along_mps, across_mps))

    def observe(self, captured_s: float, directions_rad: Mapping[str, float], sigma_rad: Mapping[str, float]) -> bool:
        """Take in the directions (polar, formation frame) of one report; False when it was rejected as an outlier.

        The report must hold the guide and both transmitters of the stop reference.
        """
        if captured_s > self._state_time_s:
            self._state, self._covariance = self._carried_on(captured_s)
            self._state_time_s = captured_s
        first, second = self.leg.stop_reference
        guide = self.leg.guide
        expected, jacobian = self._expected()
        innovation = np.array(
            [
                wrap(directions_rad[second] - directions_rad[first] - expected[0]),
                wrap(directions_rad[guide] - expected[1]),
            ]
        )
        noise = _angle_covariance(self.leg, sigma_rad)
        spread = jacobian @ self._covariance @ jacobian.T + noise
        if np.any(np.abs(innovation) > OUTLIER_SIGMAS * np.sqrt(np.diag(spread))):
            self.outliers += 1
            self._covariance = self._covariance + _DOUBT
            return False
        gain = np.linalg.solve(spread, jacobian @ self._covariance).T
        self._state = self._state + gain @ innovation
        reduced = np.eye(4) - gain @ jacobian
        self._covariance = reduced @ self._covariance @ reduced.T + gain @ noise @ gain.T
        return True

    @property
    def dwelling(self) -> bool:
        """Whether the stop condition held when it was last asked for."""
        return self._within_since_s is not None

    def estimate(self, now_s: float) -> LegEstimate:
        """Return where the receiver is by `now_s`, carried on from the last report with what was commanded."""
        state, covariance = self._carried_on(max(now_s, self._state_time_s))
        remaining, cross_track, progress, _ = (float(value) for value in state)
        return LegEstimate(remaining, cross_track, progress, math.sqrt(max(float(covariance[0, 0]), 0.0)))

    def arrived(self, now_s: float) -> bool:
        """Return whether the stop condition holds: near, without a break, for the dwell."""
        estimate = self.estimate(now_s)
        off_m = max(abs(estimate.remaining_m), abs(estimate.cross_track_m) if self.rule.on_line else 0.0)
        if off_m > max(self._band_m(off_m, now_s), estimate.remaining_sigma_m):
            self._within_since_s = None
            return False
        if self._within_since_s is None:
            self._within_since_s = now_s
        return now_s - self._within_since_s >= self.rule.dwell_s

    def _band_m(self, off_m: float, now_s: float) -> float:
        """Return how near is near enough: the rule's band, widened for a vehicle that hovers about its end."""
        if off_m > _NEAR_M:
            self._near_since_s = now_s
        waited_s = max(0.0, now_s - self._near_since_s - _PATIENCE_S)
        return max(self.rule.band_m, min(self.rule.band_m + _WIDENING_MPS * waited_s, self.rule.widest_m))

    def place(self) -> tuple[complex, NDArray[np.float64]]:
        """Return the receiver's place at the last report, formation frame, m, and its covariance, m^2."""
        to_formation = _leg_axes(self.course)
        return self._place(), to_formation @ self._covariance[:2, :2] @ to_formation.T

    def _place(self) -> complex:
        return self.leg.end - self.course * complex(self._state[0], -self._state[1])

    def _expected(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (subtended angle, guide direction) expected at the state, and their gradient by the state."""
        place = self._place()
        names = (*self.leg.stop_reference, self.leg.guide)
        sights = [self.transmitters[name] - place for name in names]
        sights = [sight if abs(sight) > _NEAREST_M else complex(_NEAREST_M) for sight in sights]
        direction = [float(np.angle(sight)) for sight in sights]
        by_s = [(self.course / sight).imag for sight in sights]
        by_e = [(-1j * self.course / sight).imag for sight in sights]
        jacobian = np.array(
            [[by_s[1] - by_s[0], by_e[1] - by_e[0], 0.0, 0.0], [by_s[2], by_e[2], 0.0, 0.0]],
        )
        return np.array([direction[1] - direction[0], direction[2]]), jacobian

    def _carried_on(self, until_s: float) -> tuple[State, NDArray[np.float64]]:
        """Return state and covariance at a later time, the vehicle following its commands with delay and lag."""
        state, covariance, at_s = self._state, self._covariance, self._state_time_s
        for time_s, (along_mps, across_mps) in self._steps(at_s, until_s):
            step_s = time_s - at_s
            follow = 1.0 - math.exp(-step_s / RESPONSE_TIME_S)
            kept = 1.0 - follow
            moves = RESPONSE_TIME_S * follow
            transition = np.array(
                [[1.0, 0.0, -moves, 0.0], [0.0, 1.0, 0.0, moves], [0.0, 0.0, kept, 0.0], [0.0, 0.0, 0.0, kept]]
            )
            coasts = step_s - moves
            driven = np.array([-coasts * along_mps, coasts * across_mps, follow * along_mps, follow * across_mps])
            state = transition @ state + driven
            stray = HOVER_NOISE + SPEED_NOISE_PER_MPS * math.hypot(along_mps, across_mps)
            covariance = transition @ covariance @ transition.T
            covariance[2, 2] += stray**2 * step_s
            covariance[3, 3] += stray**2 * step_s
            at_s = time_s
        return state, covariance

    def _steps(self, from_s: float, until_s: float) -> list[tuple[float, tuple[float, float]]]:
        """Return (end of step, command in effect) for every piece of constant command between two times."""
        steps: list[tuple[float, tuple[float, float]]] = []
        effective = (0.0, 0.0)
        for time_s, along_mps, across_mps in self._commands:
            starts_s = time_s + COMMAND_DELAY_S
            if starts_s >= until_s:
                break
            if starts_s > from_s:
                steps.append((starts_s, effective))
            effective = (along_mps, across_mps)
        if until_s > from_s:
            steps.append((until_s, effective))
        return steps


def _leg_axes(course: complex) -> NDArray[np.float64]:
    """Return the orthogonal matrix from (s, e) to (x, y): its columns point back along the leg and to its left."""
    return np.array([[-course.real, -course.imag], [-course.imag, course.real]])


def _angle_covariance(leg: Leg, sigma_rad: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the covariance of (subtended angle, guide direction); they share the guide's noise when it is in both."""
    first, second = leg.stop_reference
    shared = {second: 1.0, first: -1.0}.get(leg.guide, 0.0) * sigma_rad[leg.guide] ** 2
    return np.array([[sigma_rad[first] ** 2 + sigma_rad[second] ** 2, shared], [shared, sigma_rad[leg.guide] ** 2]])
