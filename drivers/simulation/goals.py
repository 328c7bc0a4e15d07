"""What a flight mode asks of the position controller, and the reference motion the controller makes of it.

Each goal moves the reference one step; the airframe (`dynamics`) then follows the reference.
North, east, down, relative to the place of switch-on.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Protocol

from drivers.simulation.airframe import air_drag_per_s
from drivers.simulation.shaping import approach_speed, clamp, shape_velocity, shape_velocity_2d, sqrt_controller

OVERSPEED_GAIN = 2.0  # POSCONTROL_OVERSPEED_GAIN_Z: acceleration allowed above the vertical speed limits
FASTEST_VERTICAL_MPS = 25.0  # no copter climbs or sinks faster, whatever it is asked

LOITER_DRAG_PER_S = 0.16  # fitted
LOITER_BRAKE_MPS2 = 2.5  # LOIT_BRK_ACCEL
LOITER_BRAKE_MPS3 = 5.0  # LOIT_BRK_JERK


@dataclass(slots=True)
class Reference:
    """The position, velocity and acceleration the controller wants: m, m/s, m/s2, north-east-down."""

    north_m: float = 0.0
    east_m: float = 0.0
    down_m: float = 0.0
    v_north_mps: float = 0.0
    v_east_mps: float = 0.0
    v_down_mps: float = 0.0
    a_north_mps2: float = 0.0
    a_east_mps2: float = 0.0
    a_down_mps2: float = 0.0

    def move_horizontally(self, accel_mps2: tuple[float, float], dt_s: float) -> None:
        """Integrate one step under a horizontal acceleration."""
        self.a_north_mps2, self.a_east_mps2 = accel_mps2
        self.v_north_mps += self.a_north_mps2 * dt_s
        self.v_east_mps += self.a_east_mps2 * dt_s
        self.north_m += self.v_north_mps * dt_s
        self.east_m += self.v_east_mps * dt_s


@dataclass(frozen=True, slots=True)
class HorizontalLimits:
    """Acceleration and jerk of a horizontal manoeuvre: m/s2, m/s3."""

    accel_mps2: float = 2.5
    jerk_mps3: float = 5.0


@dataclass(frozen=True, slots=True)
class VerticalLimits:
    """Acceleration, jerk and the speeds a manoeuvre is meant to keep: m/s2, m/s3, m/s."""

    accel_mps2: float = 1.0
    jerk_mps3: float = 5.0
    climb_mps: float = 2.5
    sink_mps: float = 1.5

    def gain_at(self, v_down_mps: float) -> float:
        """Return by how much acceleration and jerk grow at a speed: beyond the speed limits they do."""
        over = abs(v_down_mps) / (self.sink_mps if v_down_mps > 0.0 else self.climb_mps)
        return OVERSPEED_GAIN * over if over > 1.0 else 1.0


class HorizontalGoal(Protocol):
    """Where to go in the plane."""

    def lead(self, reference: Reference, dt_s: float) -> None:
        """Move the reference's horizontal part by one step."""
        ...


class VerticalGoal(Protocol):
    """Where to go in height."""

    def lead(self, reference: Reference, dt_s: float) -> None:
        """Move the reference's vertical part by one step."""
        ...


@dataclass(frozen=True, slots=True)
class Velocity:
    """Fly at a horizontal velocity, m/s; the default stops and then holds position."""

    north_mps: float = 0.0
    east_mps: float = 0.0
    limits: HorizontalLimits = HorizontalLimits()

    def lead(self, reference: Reference, dt_s: float) -> None:
        """Move the reference towards the velocity."""
        error = (self.north_mps - reference.v_north_mps, self.east_mps - reference.v_east_mps)
        accel = (reference.a_north_mps2, reference.a_east_mps2)
        limits = self.limits
        reference.move_horizontally(shape_velocity_2d(error, accel, limits.accel_mps2, limits.jerk_mps3, dt_s), dt_s)


@dataclass(frozen=True, slots=True)
class Place:
    """Fly straight to a place, m, no faster than a speed, m/s, and stop there."""

    north_m: float
    east_m: float
    speed_mps: float
    limits: HorizontalLimits = HorizontalLimits()

    def lead(self, reference: Reference, dt_s: float) -> None:
        """Move the reference towards the place."""
        north_m, east_m = self.north_m - reference.north_m, self.east_m - reference.east_m
        distance_m = hypot(north_m, east_m)
        closing_mps = approach_speed(distance_m, self.limits.accel_mps2, self.limits.jerk_mps3)
        rate = min(closing_mps, self.speed_mps) / distance_m if distance_m > 0.0 else 0.0
        Velocity(north_m * rate, east_m * rate, self.limits).lead(reference, dt_s)


@dataclass(frozen=True, slots=True)
class Loiter:
    """Let go of the stick `elapsed_s` ago: drag and a brake that ramps up stop the copter along its course."""

    elapsed_s: float

    def lead(self, reference: Reference, dt_s: float) -> None:
        """Slow the reference down."""
        speed_mps = hypot(reference.v_north_mps, reference.v_east_mps)
        if speed_mps == 0.0:
            reference.move_horizontally((0.0, 0.0), dt_s)
            return
        brake_mps2 = min(sqrt_controller(speed_mps, 1.0, LOITER_BRAKE_MPS3), LOITER_BRAKE_MPS2)
        brake_mps2 = min(brake_mps2, LOITER_BRAKE_MPS3 * self.elapsed_s)
        rate = -min(LOITER_DRAG_PER_S + brake_mps2 / speed_mps, 1.0 / dt_s)
        reference.move_horizontally((reference.v_north_mps * rate, reference.v_east_mps * rate), dt_s)


@dataclass(frozen=True, slots=True)
class Coast:
    """Hold the copter level: only air drag slows it (STABILIZE and ALT_HOLD with centred sticks)."""

    def lead(self, reference: Reference, dt_s: float) -> None:
        """Let drag slow the reference down."""
        drag = -air_drag_per_s(hypot(reference.v_north_mps, reference.v_east_mps))
        reference.move_horizontally((reference.v_north_mps * drag, reference.v_east_mps * drag), dt_s)


@dataclass(frozen=True, slots=True)
class Climb:
    """Sink at a speed, m/s down (negative climbs); the vertical speed limits do not bound it."""

    down_mps: float = 0.0
    limits: VerticalLimits = VerticalLimits()

    def lead(self, reference: Reference, dt_s: float) -> None:
        """Move the reference towards the vertical speed."""
        goal_mps = clamp(self.down_mps, -FASTEST_VERTICAL_MPS, FASTEST_VERTICAL_MPS)
        gain = self.limits.gain_at(reference.v_down_mps)
        accel_max_mps2, jerk_mps3 = self.limits.accel_mps2 * gain, self.limits.jerk_mps3 * gain
        error_mps = goal_mps - reference.v_down_mps
        reference.a_down_mps2 = shape_velocity(error_mps, reference.a_down_mps2, accel_max_mps2, jerk_mps3, dt_s)
        reference.v_down_mps += reference.a_down_mps2 * dt_s
        reference.down_m += reference.v_down_mps * dt_s


@dataclass(frozen=True, slots=True)
class Height:
    """Climb or sink to a height, m down (negative is up), within the vertical speed limits."""

    down_m: float
    limits: VerticalLimits = VerticalLimits()

    def lead(self, reference: Reference, dt_s: float) -> None:
        """Move the reference towards the height."""
        limits = self.limits
        closing_mps = approach_speed(self.down_m - reference.down_m, limits.accel_mps2, limits.jerk_mps3)
        Climb(clamp(closing_mps, -limits.climb_mps, limits.sink_mps), limits).lead(reference, dt_s)


@dataclass(frozen=True, slots=True)
class HoldNose:
    """Keep the heading."""


@dataclass(frozen=True, slots=True)
class NoseAlongCourse:
    """Turn the nose to where the reference moves (WP_YAW_BEHAVIOR other than 0)."""


@dataclass(frozen=True, slots=True)
class NoseTo:
    """Turn the nose to a heading, rad."""

    heading_rad: float


@dataclass(frozen=True, slots=True)
class NoseTurning:
    """Turn the nose at a rate, rad/s, clockwise."""

    rate_radps: float


NoseGoal = HoldNose | NoseAlongCourse | NoseTo | NoseTurning


@dataclass(frozen=True, slots=True)
class Goal:
    """All that a mode asks for in one step."""

    horizontal: HorizontalGoal = Velocity()
    vertical: VerticalGoal = Climb()
    nose: NoseGoal = HoldNose()


HOVER = Goal()
