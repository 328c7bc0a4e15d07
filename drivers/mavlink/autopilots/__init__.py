"""Autopilot strategies: one module each, one line each in the registry."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.autopilots.px4 import Px4Copter
from drivers.mavlink.vehicle import Heartbeat, Vehicle

AUTOPILOTS: Final[Mapping[str, tuple[int, Autopilot]]] = {
    "ardupilot": (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, ArduCopter()),
    "px4": (mavlink.MAV_AUTOPILOT_PX4, Px4Copter()),
}
"""By the name a playbook gives them: the MAV_AUTOPILOT of its heartbeat, and the strategy."""

_NOT_FLOWN: Final = {
    mavlink.MAV_TYPE_FIXED_WING: "a plane",
    mavlink.MAV_TYPE_HELICOPTER: "a helicopter",
    mavlink.MAV_TYPE_AIRSHIP: "a blimp",
    mavlink.MAV_TYPE_GROUND_ROVER: "a rover",
    mavlink.MAV_TYPE_SURFACE_BOAT: "a boat",
    mavlink.MAV_TYPE_SUBMARINE: "a submarine",
}


def autopilot_of(vehicle: Vehicle, wanted: str | None = None) -> Autopilot:
    """Return the strategy for what the vehicle's heartbeat says it is; VehicleError when there is none.

    One `wanted` by its name stands for an autopilot that does not say which it is; a heartbeat that names another one
    is an error.
    """
    heartbeat = vehicle.telemetry.heartbeat
    if heartbeat is None:
        raise vehicle.failure("has not sent a heartbeat", "Check the link address and that the autopilot runs.")
    told = next((name for name, (number, _) in AUTOPILOTS.items() if number == heartbeat.autopilot), None)
    if told is not None and wanted is not None and told != wanted:
        raise vehicle.failure(
            f"is {AUTOPILOTS[told][1].name}, and the playbook names {AUTOPILOTS[wanted][1].name}",
            "Correct the vehicle's autopilot in the playbook, or its link and system id.",
        )
    name = told or wanted
    if name is None or heartbeat.vehicle_type not in AUTOPILOTS[name][1].vehicle_types:
        raise vehicle.failure(
            f"is {_described(heartbeat)}, which is not supported", "It flies multicopters with ArduPilot or PX4."
        )
    return AUTOPILOTS[name][1]


def _described(heartbeat: Heartbeat) -> str:
    """Return what a heartbeat says of its sender."""
    autopilot = _words("MAV_AUTOPILOT", heartbeat.autopilot)
    for number, strategy in AUTOPILOTS.values():
        if number == heartbeat.autopilot:
            autopilot = strategy.name
    vehicle_type = _NOT_FLOWN.get(heartbeat.vehicle_type) or _words("MAV_TYPE", heartbeat.vehicle_type)
    return f"{vehicle_type} with {autopilot} (vehicle type {heartbeat.vehicle_type}, autopilot {heartbeat.autopilot})"


def _words(enum: str, value: int) -> str:
    """Return MAVLink's name of an enumeration's value, in words."""
    entry = mavlink.enums[enum].get(value)
    return "unknown" if entry is None else entry.name.removeprefix(f"{enum}_").replace("_", " ").lower()
