"""The airframe and its velocity loops: one axis of motion with lag, and the air it moves through.

Gains are ArduCopter's defaults; the lags and the drag are fitted to an ArduCopter 4.6 in SITL.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from math import exp, hypot, pi, sqrt

STEP_S = 0.02
POSITION_GAIN = 1.0  # PSC_POSXY_P, PSC_POSZ_P
DERIVATIVE_FILTER = STEP_S / (STEP_S + 1.0 / (2.0 * pi * 5.0))  # PSC_VELXY_FLTD 5 Hz
DRAG_PER_S = 0.2
DRAG_PER_M = 0.045
GUST_TIME_S = 3.0


def air_drag_per_s(airspeed_mps: float) -> float:
    """Return the deceleration by drag per unit of airspeed, 1/s."""
    return DRAG_PER_S + DRAG_PER_M * airspeed_mps


@dataclass(frozen=True, slots=True)
class AxisGains:
    """Velocity PID of one axis and the time constant, s, of each of the two lags behind it."""

    p: float
    i: float
    d: float
    lag_s: float


HORIZONTAL_GAINS = AxisGains(p=2.0, i=1.0, d=0.25, lag_s=0.1)  # PSC_VELXY_P, _I, _D
VERTICAL_GAINS = AxisGains(p=5.0, i=0.0, d=0.0, lag_s=0.04)  # PSC_VELZ_P


class Axis:
    """One axis of the vehicle: where it is, and what its controller remembers."""

    __slots__ = ("_demand", "_derivative", "_error", "_gains", "_integral", "accel_mps2", "position_m", "velocity_mps")

    def __init__(self, gains: AxisGains) -> None:
        self._gains = gains
        self.position_m = 0.0
        self.rest()

    def rest(self) -> None:
        """Stop at once and forget (on the ground)."""
        self.velocity_mps = 0.0
        self.accel_mps2 = 0.0
        self._demand = 0.0
        self._integral = 0.0
        self._error = 0.0
        self._derivative = 0.0

    def follow(self, position_m: float, velocity_mps: float, accel_mps2: float, air_accel_mps2: float) -> None:
        """Move one step after a reference, under an acceleration by the air."""
        gains = self._gains
        error = velocity_mps + POSITION_GAIN * (position_m - self.position_m) - self.velocity_mps
        self._integral += gains.i * error * STEP_S
        self._derivative += ((error - self._error) / STEP_S - self._derivative) * DERIVATIVE_FILTER
        self._error = error
        wanted = accel_mps2 + gains.p * error + self._integral + gains.d * self._derivative
        self._demand += (wanted - self._demand) * STEP_S / gains.lag_s
        self.accel_mps2 += (self._demand - self.accel_mps2) * STEP_S / gains.lag_s
        self.velocity_mps += (self.accel_mps2 + air_accel_mps2) * STEP_S
        self.position_m += self.velocity_mps * STEP_S


@dataclass(frozen=True, slots=True)
class Wind:
    """Steady wind, m/s towards north and east, and the standard deviation of its gusts, m/s."""

    north_mps: float = 0.0
    east_mps: float = 0.0
    gust_mps: float = 0.0


CALM = Wind()


class Air:
    """The air around one copter: wind, and gusts that are the same for the same seed."""

    def __init__(self, seed: int) -> None:
        self.wind = CALM
        self._gust_north_mps = 0.0
        self._gust_east_mps = 0.0
        self._random = random.Random(seed)  # noqa: S311 - weather, not secrets

    def drag_mps2(self, v_north_mps: float, v_east_mps: float) -> tuple[float, float]:
        """Return the acceleration by drag, north and east, at a velocity over ground; advances the gusts."""
        wind = self.wind
        if wind.gust_mps > 0.0:
            self._blow(wind.gust_mps)
        north_mps = v_north_mps - wind.north_mps - self._gust_north_mps
        east_mps = v_east_mps - wind.east_mps - self._gust_east_mps
        drag = -air_drag_per_s(hypot(north_mps, east_mps))
        return drag * north_mps, drag * east_mps

    def _blow(self, gust_mps: float) -> None:
        keep = exp(-STEP_S / GUST_TIME_S)
        kick_mps = gust_mps * sqrt(1.0 - keep * keep)
        self._gust_north_mps = self._gust_north_mps * keep + self._random.gauss(0.0, kick_mps)
        self._gust_east_mps = self._gust_east_mps * keep + self._random.gauss(0.0, kick_mps)
