"""What a fault does to vehicles, sensors and bus when it strikes, and within what time it must stop whom."""

from __future__ import annotations

import cmath
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final

from gcs.faults.bus import FaultyBus
from gcs.faults.fault import OF_THE_LINK, Fault, Kind
from gcs.faults.sensor import FaultySensor
from gcs.faults.vehicle import FaultyVehicle

FOR_ALL: Final[frozenset[Kind]] = frozenset(
    {
        *("bus_lost", "router_restarted", "transmitter_silent", "pilot_receiver", "pilot_transmitter"),
        *("service_stopped", "service_killed"),
    }
)
"""What must stop all that fly, not its target alone."""

FOR_WHO_FLIES: Final[frozenset[Kind]] = frozenset({"sensor_jump", "transmitter_silent"})
"""What must stop those only that are under way: whoever is located later is located with it, or without."""

_LATENCY_S: Final = 0.2
"""What was measured before is still on its way."""
_NOTICED_S: Final = 0.5
"""Bearings that are missed or contradict, and missing telemetry, are noticed within this."""
_SEEN_S: Final = 0.2
"""A pilot's mode is seen, and everybody told to hold, within this."""
OWN_TIME_OUT_S: Final = 3.1
"""Without setpoints a copter's own guided mode ends its velocity after this."""
_TOO_OLD_S: Final = 0.5


@dataclass(frozen=True)
class Plant:
    """What can fail."""

    vehicles: Mapping[str, FaultyVehicle]
    sensors: Mapping[str, FaultySensor]
    bus: FaultyBus


def switch(plant: Plant, fault: Fault, *, on: bool) -> None:
    """Let a fault begin, or end."""
    if fault.target in plant.vehicles and _switch_vehicle(plant.vehicles[fault.target], fault, on=on):
        return
    if fault.kind == "bus_lost":
        (plant.bus.go if on else plant.bus.come_back)()
    elif fault.kind == "router_restarted":
        (plant.bus.go if on else plant.bus.start_anew)()
    elif fault.kind == "report_loss":
        plant.bus.lost_share[fault.target] = fault.amount if on else 0.0
    elif fault.kind == "report_duplication":
        plant.bus.repeated_share[fault.target] = fault.amount if on else 0.0
    elif fault.kind == "transmitter_silent":
        for sensor in plant.sensors.values():
            (sensor.muted.add if on else sensor.muted.discard)(fault.target)
    elif on:
        plant.sensors[fault.target].strike(fault)
    else:
        plant.sensors[fault.target].mend(fault.kind)


def _switch_vehicle(vehicle: FaultyVehicle, fault: Fault, *, on: bool) -> bool:
    """Return whether it is a fault of a vehicle."""
    if fault.kind == "telemetry_lost":
        vehicle.fall_silent(silent=on)
    elif fault.kind == "link_cut":
        vehicle.cut_link(cut=on)
    elif fault.kind == "vehicle_frozen":
        vehicle.freeze(frozen=on)
    elif fault.kind == "vehicle_reboot":
        vehicle.reboot(down=on)
    elif fault.kind == "battery_low":
        vehicle.drain(drained=on)
    elif fault.kind in OF_THE_LINK:
        vehicle.impair(**{OF_THE_LINK[fault.kind]: fault.amount if on else 0.0})
    elif fault.kind == "transmitter_drift":
        vehicle.drift(cmath.rect(fault.amount, fault.course_rad) if on else 0j)
    elif fault.kind in ("pilot_receiver", "pilot_transmitter") and on:
        vehicle.take_over()
    else:
        return fault.kind in ("pilot_receiver", "pilot_transmitter")
    return True


def stop_within_s(
    fault: Fault, on_air: Collection[str], lease_s: float, *, done: bool, cut: bool, from_north: bool
) -> float | None:
    """Return the time within which a fault must have ended the commands of those who fly under it; None: it need not.

    `done`: its target is not on its way any more. Where a link is `cut` nothing that is commanded counts, and the
    vehicle itself ends its velocity. Where bearings are not `from_north` a jump of all is a nose that has turned.
    """
    heard = set(on_air)
    within_s: dict[Kind, float] = {
        "bus_lost": lease_s + _LATENCY_S,
        "router_restarted": lease_s + _LATENCY_S,
        "sensor_silent": lease_s + _LATENCY_S,
        "sensor_stuck": lease_s + _LATENCY_S + _NOTICED_S,
        "telemetry_lost": _LATENCY_S + _NOTICED_S,
        "vehicle_frozen": 0.0,
        "vehicle_reboot": 0.0,
        "battery_low": _LATENCY_S + _NOTICED_S,
        "link_cut": OWN_TIME_OUT_S,
        "service_stopped": OWN_TIME_OUT_S,
        "service_killed": OWN_TIME_OUT_S,
    }
    if (fault.of is None and from_north) or (fault.of in heard and len(heard) <= 2):
        within_s["sensor_jump"] = lease_s + _LATENCY_S + _NOTICED_S
    if fault.target in heard and len(heard) <= 2:
        within_s["transmitter_silent"] = lease_s + _LATENCY_S + _NOTICED_S
    if fault.target in heard or not done:
        within_s["pilot_receiver"] = _SEEN_S
    if fault.target in heard:
        within_s["pilot_transmitter"] = _SEEN_S
    if fault.kind == "report_delay" and fault.amount > _TOO_OLD_S:
        within_s["report_delay"] = lease_s + _LATENCY_S
    stops_s = within_s.get(fault.kind)
    return stops_s if stops_s is None or not cut else max(stops_s, OWN_TIME_OUT_S)
