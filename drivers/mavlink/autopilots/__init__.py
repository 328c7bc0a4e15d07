"""Autopilot strategies: one module each, one line each in the registry."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.autopilots.px4 import Px4Copter
from drivers.mavlink.vehicle import Vehicle

AUTOPILOTS: dict[int, Autopilot] = {
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: ArduCopter(),
    mavlink.MAV_AUTOPILOT_PX4: Px4Copter(),
}


def autopilot_of(vehicle: Vehicle) -> Autopilot:
    """Return the strategy for what the vehicle's heartbeat says it is; VehicleError when there is none."""
    heartbeat = vehicle.telemetry.heartbeat
    if heartbeat is None:
        raise vehicle.failure("has not sent a heartbeat", "Check the link address and that the autopilot runs.")
    strategy = AUTOPILOTS.get(heartbeat.autopilot)
    if strategy is None or heartbeat.vehicle_type not in strategy.vehicle_types:
        autopilot = _words("MAV_AUTOPILOT", heartbeat.autopilot)
        vehicle_type = _words("MAV_TYPE", heartbeat.vehicle_type)
        raise vehicle.failure(
            f"is autopilot {heartbeat.autopilot} on vehicle type {heartbeat.vehicle_type} "
            f"({autopilot}, {vehicle_type}), which is not supported",
            "It flies multicopters with ArduPilot or PX4.",
        )
    return strategy


def _words(enum: str, value: int) -> str:
    """Return MAVLink's name of an enumeration's value, in words."""
    entry = mavlink.enums[enum].get(value)
    return "unknown" if entry is None else entry.name.removeprefix(f"{enum}_").replace("_", " ").lower()
