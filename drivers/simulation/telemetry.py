"""What an ArduCopter reports: one function per message, all of them pure views of a vehicle."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, degrees, pi
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation.goals import Climb, Velocity
from drivers.simulation.modes import Mode
from drivers.simulation.shaping import clamp
from drivers.simulation.vehicle import HOVER_CURRENT_A, Vehicle

Message = Any
"""A pymavlink message; pymavlink carries no types."""

EKF_FLAGS_READY = 0x33F  # attitude, velocity and position, relative and absolute; 16 is absolute position
EKF_FLAGS_ALIGNING = 0xA7  # attitude, vertical position; constant position mode
SENSORS = 0x01 | 0x02 | 0x04 | 0x08 | 0x20 | 0x8000 | 0x20_0000 | 0x200_0000  # gyro to AHRS and battery
PREARM_CHECK = 0x1000_0000
CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
FLIGHT_VERSION = 4 << 24 | 6 << 16 | 2 << 8 | 255  # the release whose behaviour is modelled: 4.6.2
CELL_MV = 4000
MODES_WITH_POSITION = frozenset({Mode.GUIDED, Mode.LOITER, Mode.RTL, Mode.BRAKE})


def _int16(value: float) -> int:
    return round(clamp(value, -32768.0, 32767.0))


def _heading_cdeg(vehicle: Vehicle) -> int:
    return round(degrees(vehicle.flight.dynamics.heading_rad) * 100.0) % 36000


def heartbeat(vehicle: Vehicle) -> Message:
    """HEARTBEAT: mode, armed or not."""
    flight = vehicle.flight
    base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    base_mode |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    if flight.mode in MODES_WITH_POSITION:
        base_mode |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    if flight.armed:
        base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    state = mavlink.MAV_STATE_STANDBY if flight.landed else mavlink.MAV_STATE_ACTIVE
    if vehicle.failsafe.on:
        state = mavlink.MAV_STATE_CRITICAL
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, base_mode, int(flight.mode), state, 3
    )


def sys_status(vehicle: Vehicle) -> Message:
    """SYS_STATUS: sensors, readiness to arm, battery."""
    health = SENSORS | PREARM_CHECK if vehicle.flight.ready else SENSORS & ~0x20_0000
    current_ca = round(HOVER_CURRENT_A * 100.0) if vehicle.flight.armed else 0
    present = SENSORS | PREARM_CHECK
    return mavlink.MAVLink_sys_status_message(
        present, present, health, 100, 3 * CELL_MV, current_ca, vehicle.battery_percent, 0, 0, 0, 0, 0, 0
    )


def battery_status(vehicle: Vehicle) -> Message:
    """BATTERY_STATUS: the same battery in detail."""
    current_ca = round(HOVER_CURRENT_A * 100.0) if vehicle.flight.armed else 0
    cells = [CELL_MV] * 3 + [65535] * 7
    return mavlink.MAVLink_battery_status_message(
        0, 0, 0, 32767, cells, current_ca, round(vehicle.used_charge_mah), -1, vehicle.battery_percent
    )


def system_time(vehicle: Vehicle) -> Message:
    """SYSTEM_TIME: simulated time."""
    return mavlink.MAVLink_system_time_message(vehicle.unix_us, vehicle.boot_ms)


def gps_raw_int(vehicle: Vehicle) -> Message:
    """GPS_RAW_INT: a perfect receiver."""
    dynamics = vehicle.flight.dynamics
    course_deg = degrees(atan2(dynamics.east.velocity_mps, dynamics.north.velocity_mps)) % 360.0
    speed_cmps = min(round(dynamics.ground_speed_mps * 100.0), 65534)
    altitude_mm = round(vehicle.altitude_m * 1000.0)
    return mavlink.MAVLink_gps_raw_int_message(
        round(vehicle.flight.time_s * 1e6),
        mavlink.GPS_FIX_TYPE_RTK_FIXED if vehicle.flight.ready else mavlink.GPS_FIX_TYPE_NO_FIX,
        *vehicle.position_e7,
        altitude_mm,
        121,
        200,
        speed_cmps,
        round(course_deg * 100.0) % 36000,
        10,
    )


def ekf_status_report(vehicle: Vehicle) -> Message:
    """EKF_STATUS_REPORT: flag 16 when the position is good enough to arm."""
    flags = EKF_FLAGS_READY if vehicle.flight.ready else EKF_FLAGS_ALIGNING
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.02, 0.02, 0.02, 0.02, 0.0, 0.0)


def global_position_int(vehicle: Vehicle) -> Message:
    """GLOBAL_POSITION_INT: where on Earth."""
    dynamics = vehicle.flight.dynamics
    return mavlink.MAVLink_global_position_int_message(
        vehicle.boot_ms,
        *vehicle.position_e7,
        round(vehicle.altitude_m * 1000.0),
        round(dynamics.height_m * 1000.0),
        _int16(dynamics.north.velocity_mps * 100.0),
        _int16(dynamics.east.velocity_mps * 100.0),
        _int16(dynamics.down.velocity_mps * 100.0),
        _heading_cdeg(vehicle),
    )


def local_position_ned(vehicle: Vehicle) -> Message:
    """LOCAL_POSITION_NED: from this vehicle's own origin, the place of switch-on."""
    axes = (vehicle.flight.dynamics.north, vehicle.flight.dynamics.east, vehicle.flight.dynamics.down)
    return mavlink.MAVLink_local_position_ned_message(
        vehicle.boot_ms, *(axis.position_m for axis in axes), *(axis.velocity_mps for axis in axes)
    )


def attitude(vehicle: Vehicle) -> Message:
    """ATTITUDE: lean and heading."""
    dynamics = vehicle.flight.dynamics
    yaw_rad = (dynamics.heading_rad + pi) % (2.0 * pi) - pi
    return mavlink.MAVLink_attitude_message(
        vehicle.boot_ms, *dynamics.attitude_rad(), yaw_rad, 0.0, 0.0, dynamics.turn_rate_radps
    )


def vfr_hud(vehicle: Vehicle) -> Message:
    """VFR_HUD: the numbers on a head-up display."""
    dynamics = vehicle.flight.dynamics
    speed_mps, throttle = dynamics.ground_speed_mps, 0 if vehicle.flight.landed else 35
    heading_deg = _heading_cdeg(vehicle) // 100
    return mavlink.MAVLink_vfr_hud_message(
        speed_mps, speed_mps, heading_deg, throttle, vehicle.altitude_m, -dynamics.down.velocity_mps
    )


def extended_sys_state(vehicle: Vehicle) -> Message:
    """EXTENDED_SYS_STATE: on the ground, landing or in the air."""
    flight = vehicle.flight
    state = mavlink.MAV_LANDED_STATE_LANDING if flight.mode is Mode.LAND else mavlink.MAV_LANDED_STATE_IN_AIR
    if flight.landed:
        state = mavlink.MAV_LANDED_STATE_ON_GROUND
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, state)


def home_position(vehicle: Vehicle) -> Message:
    """HOME_POSITION: where it was armed."""
    north_m, east_m = vehicle.flight.home_m
    altitude_mm = round(vehicle.frame.origin.altitude_m * 1000.0)
    return mavlink.MAVLink_home_position_message(
        *vehicle.place_e7(north_m, east_m), altitude_mm, north_m, east_m, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0
    )


def gps_global_origin(vehicle: Vehicle) -> Message:
    """GPS_GLOBAL_ORIGIN: the origin of LOCAL_POSITION_NED."""
    return mavlink.MAVLink_gps_global_origin_message(
        *vehicle.place_e7(0.0, 0.0), round(vehicle.frame.origin.altitude_m * 1000.0)
    )


def autopilot_version(vehicle: Vehicle) -> Message:
    """AUTOPILOT_VERSION: what it can do, and an id of its own."""
    uid2 = [*vehicle.uid.to_bytes(8, "little"), *([0] * 10)]
    return mavlink.MAVLink_autopilot_version_message(
        CAPABILITIES, FLIGHT_VERSION, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, vehicle.uid, uid2
    )


def position_target_local_ned(vehicle: Vehicle) -> Message:
    """POSITION_TARGET_LOCAL_NED: the setpoint it obeys."""
    goal, reference = vehicle.flight.order.goal, vehicle.flight.dynamics.reference
    horizontal, vertical = goal.horizontal, goal.vertical
    mask, velocity_mps = 0x0DF8, (0.0, 0.0, 0.0)
    if isinstance(horizontal, Velocity) and isinstance(vertical, Climb):
        mask, velocity_mps = 0x0DC7, (horizontal.north_mps, horizontal.east_mps, vertical.down_mps)
    return mavlink.MAVLink_position_target_local_ned_message(
        vehicle.boot_ms,
        mavlink.MAV_FRAME_LOCAL_NED,
        mask,
        reference.north_m,
        reference.east_m,
        reference.down_m,
        *velocity_mps,
        *(0.0, 0.0, 0.0, 0.0, 0.0),
    )


REPORTS: dict[int, Callable[[Vehicle], Message]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: position_target_local_ned,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ekf_status_report,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
}
