"""The two setpoint messages that ever leave: a velocity, and a place to hold. Both hold the heading by yaw rate 0."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Message
from planner.frames import GeodeticPosition

VELOCITY_MASK: Final = 0x05C7
"""Velocity and yaw rate only; yaw rate 0 holds the heading, which antenna arrays care about."""
POSITION_MASK: Final = 0x05F8
"""Position and yaw rate only."""


def velocity_setpoint(system_id: int, north_east_mps: complex, down_mps: float) -> Message:
    """Return a velocity setpoint in the local frame (north + i east, down), m/s."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0,
        system_id,
        mavlink.MAV_COMP_ID_AUTOPILOT1,
        mavlink.MAV_FRAME_LOCAL_NED,
        VELOCITY_MASK,
        *(0.0, 0.0, 0.0),
        *(north_east_mps.real, north_east_mps.imag, down_mps),
        *(0.0, 0.0, 0.0),
        *(0.0, 0.0),
    )


def position_setpoint(system_id: int, place: GeodeticPosition) -> Message:
    """Return a position setpoint, its altitude above sea level: PX4 gets one above home wrong by home minus origin."""
    return mavlink.MAVLink_set_position_target_global_int_message(
        0,
        system_id,
        mavlink.MAV_COMP_ID_AUTOPILOT1,
        mavlink.MAV_FRAME_GLOBAL_INT,
        POSITION_MASK,
        *(round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7), place.altitude_m),
        *(0.0, 0.0, 0.0),
        *(0.0, 0.0, 0.0),
        *(0.0, 0.0),
    )
