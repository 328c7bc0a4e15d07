"""The vehicles and their links as screens show them, from what telemetry tells."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from typing import Final, Literal

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.run_messages import LinkHealth, VehicleState
from drivers.mavlink.link_status import LinkStatus
from drivers.mavlink.mode_names import mode_name
from drivers.mavlink.vehicle import Vehicle
from gcs.monitor.run_setup import place
from gcs.monitor.sources import RunSources
from gcs.safety import PositionBoard

_GOOD: Final = (
    mavlink.ESTIMATOR_ATTITUDE
    | mavlink.ESTIMATOR_VELOCITY_HORIZ
    | mavlink.ESTIMATOR_POS_HORIZ_ABS
    | mavlink.ESTIMATOR_POS_VERT_ABS
)
_BAD: Final = (
    mavlink.ESTIMATOR_CONST_POS_MODE
    | mavlink.ESTIMATOR_GPS_GLITCH  # in ArduPilot's message: not initialised
    | mavlink.ESTIMATOR_ACCEL_ERROR
    | mavlink.EKF_GPS_GLITCHING
)


def vehicle_states(sources: RunSources) -> list[VehicleState]:
    """Return every vehicle of the run."""
    nearest = nearest_others(sources.board)
    on_air = sources.transmitting()
    return [
        _state(name, vehicle, sources, nearest.get(name), transmits=name in on_air)
        for name, vehicle in sources.vehicles.items()
    ]


def _state(
    name: str, vehicle: Vehicle, sources: RunSources, nearest: tuple[str, float] | None, *, transmits: bool
) -> VehicleState:
    telemetry, told, relay = vehicle.telemetry, sources.board.latest.get(name), sources.status.relay
    battery, kinematics = telemetry.battery, telemetry.kinematics
    if told is not None and not cmath.isfinite(told.north_east):
        told = None
    velocity = None
    if kinematics is not None:
        north_mps, east_mps, _ = kinematics.velocity_ned_mps
        velocity = place(sources.frame.from_site(complex(north_mps, east_mps)))
    return VehicleState(
        name=name,
        system_id=vehicle.system_id,
        transmits=transmits,
        pilot=relay is not None and name in relay.taken,
        at_m=None if told is None else place(sources.frame.from_site(told.north_east)),
        height_m=telemetry.relative_altitude_m,
        velocity_mps=velocity,
        heading_rad=sources.heading_rad(name),
        mode=mode_name(telemetry.heartbeat),
        armed=vehicle.armed,
        battery_percent=None if battery is None else battery.percent,
        battery_v=None if battery is None else battery.voltage_v,
        estimator=_estimator(telemetry.estimator_flags),
        silent_s=finite(vehicle.silent_for_s()),
        nearest=None if nearest is None else nearest[0],
        nearest_m=None if nearest is None else nearest[1],
    )


def _estimator(flags: int) -> Literal["good", "poor", "unknown"]:
    if not flags:
        return "unknown"
    return "good" if flags & _GOOD == _GOOD and not flags & _BAD else "poor"


def nearest_others(board: PositionBoard) -> Mapping[str, tuple[str, float]]:
    """Return who is nearest to each vehicle, and how far that is, m; none while fewer than two are known."""
    names = [name for name, told in board.latest.items() if cmath.isfinite(told.north_east)]
    if len(names) < 2:
        return {}
    places = np.array([board.latest[name].north_east for name in names])
    distances_m = np.abs(places[:, None] - places)
    np.fill_diagonal(distances_m, math.inf)
    nearest = distances_m.argmin(axis=1)
    return {name: (names[k], float(row[k])) for name, k, row in zip(names, nearest, distances_m, strict=True)}


def link_health(vehicles: str, link: LinkStatus) -> LinkHealth:
    """Return how a link fares."""
    return LinkHealth(
        vehicles=vehicles,
        address=str(link.address),
        state=link.state.value,
        received=link.received,
        sent=link.sent,
        lost=link.lost,
        refused=link.refused,
        dropped=link.dropped,
        loss=link.loss_ratio,
        silent_s=finite(link.silent_for_s),
    )


def finite(value: float) -> float | None:
    """Return a finite number, or None: JSON knows no other."""
    return value if math.isfinite(value) else None
