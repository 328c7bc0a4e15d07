"""How GUIDED reads SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT.

A velocity (with or without an acceleration, which is not used) or a position is obeyed. Anything else - an
unknown frame, a number that is none, a part-ignored velocity, an acceleration alone - stops the copter, and no
message says so.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, hypot, isfinite, sin

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation.flight import Flight, Order
from drivers.simulation.goals import Climb, Goal, Height, NoseGoal, NoseTo, NoseTurning, Place, Velocity
from drivers.simulation.telemetry import Message
from drivers.simulation.vehicle import Vehicle

POSITION_BITS, VELOCITY_BITS = 0x007, 0x038
YAW_BIT, YAW_RATE_BIT = 0x400, 0x800
OVERSHOOT = 1.03  # a command of WPNAV_SPEED or more is flown this much faster

EARTH_FRAMES = frozenset({mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED})
BODY_FRAMES = frozenset({mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED})
ABOVE_SEA_FRAMES = frozenset({mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT})
ABOVE_HOME_FRAMES = frozenset({mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})

Vector = tuple[float, float, float]


def read_local(vehicle: Vehicle, message: Message) -> Order:
    """Return what a SET_POSITION_TARGET_LOCAL_NED orders."""
    flight, frame = vehicle.flight, message.coordinate_frame
    if frame not in EARTH_FRAMES | BODY_FRAMES:
        return flight.hover()
    turned = flight.dynamics.heading_rad if frame in BODY_FRAMES else 0.0

    def position() -> Vector:
        north_m, east_m, down_m = _rotated((message.x, message.y, message.z), turned)
        if frame == mavlink.MAV_FRAME_LOCAL_NED:
            return north_m, east_m, down_m
        dynamics = flight.dynamics
        return (
            north_m + dynamics.north.position_m,
            east_m + dynamics.east.position_m,
            down_m + dynamics.down.position_m,
        )

    return _read(flight, message, turned, position)


def read_global(vehicle: Vehicle, message: Message) -> Order:
    """Return what a SET_POSITION_TARGET_GLOBAL_INT orders; its velocities are always north-east-down."""
    position_wanted = not message.type_mask & POSITION_BITS
    if position_wanted and message.coordinate_frame not in ABOVE_SEA_FRAMES | ABOVE_HOME_FRAMES:
        return vehicle.flight.hover()

    def position() -> Vector:
        sea_m = vehicle.frame.origin.altitude_m if message.coordinate_frame in ABOVE_SEA_FRAMES else 0.0
        north_m, east_m = vehicle.frame.to_metres(message.lat_int / 1e7, message.lon_int / 1e7)
        return north_m, east_m, sea_m - message.alt

    return _read(vehicle.flight, message, 0.0, position)


def go_to(flight: Flight, place: Vector, nose: NoseGoal | None = None) -> Order:
    """Return the order to fly to a place, m north-east-down, at WPNAV_SPEED, and to stay there."""
    speed_mps = flight.parameters["WPNAV_SPEED"] / 100.0
    goal = Place(place[0], place[1], speed_mps, flight.horizontal)
    return Order(Goal(goal, Height(place[2], flight.vertical), nose or flight.default_nose()))


def _read(flight: Flight, message: Message, turned: float, position: Callable[[], Vector]) -> Order:
    mask, velocity = message.type_mask, (message.vx, message.vy, message.vz)
    numbers: list[float] = []
    if not mask & POSITION_BITS:
        numbers += position()
    if not mask & VELOCITY_BITS:
        numbers += velocity
    nose_numbers = _nose_numbers(message)
    if not numbers or not all(map(isfinite, (*numbers, *nose_numbers))):
        return flight.hover()
    nose = _nose(flight, message, turned)
    if not mask & POSITION_BITS:
        return go_to(flight, position(), nose)
    north_mps, east_mps, down_mps = _rotated(velocity, turned)
    scale = _speed_scale(flight, hypot(north_mps, east_mps))
    horizontal = Velocity(north_mps * scale, east_mps * scale, flight.horizontal)
    goal = Goal(horizontal, Climb(down_mps, flight.vertical), nose)
    return Order(goal, flight.time_s + flight.parameters["GUID_TIMEOUT"])


def _rotated(vector: Vector, angle_rad: float) -> Vector:
    """Return a vector of the body's frame, whose nose points to `angle_rad`, in the earth's."""
    ahead, right, down = vector
    c, s = cos(angle_rad), sin(angle_rad)
    return ahead * c - right * s, ahead * s + right * c, down


def _speed_scale(flight: Flight, speed_mps: float) -> float:
    fastest_mps = flight.parameters["WPNAV_SPEED"] / 100.0 * OVERSHOOT
    return min(1.0, fastest_mps / speed_mps) if speed_mps > 0.0 else 1.0


def _nose_numbers(message: Message) -> list[float]:
    bits = ((YAW_BIT, message.yaw), (YAW_RATE_BIT, message.yaw_rate))
    return [value for bit, value in bits if not message.type_mask & bit]


def _nose(flight: Flight, message: Message, turned: float) -> NoseGoal:
    if not message.type_mask & YAW_BIT:
        return NoseTo(message.yaw + turned)
    if not message.type_mask & YAW_RATE_BIT:
        return NoseTurning(message.yaw_rate)
    return flight.default_nose()
