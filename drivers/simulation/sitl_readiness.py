"""Waits until simulated autopilots can fly: a heartbeat, a position estimate, and time that runs at its real rate.

ArduCopter's estimator takes 42 s of its own time, so it is started faster than real time, and slowed down once ready.
Until then its failsafe counts the same fast seconds: heartbeats go out as often.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.autopilots import autopilot_of
from drivers.mavlink.codec import Message
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.sitl import Sitl
from drivers.tasks import background

HEARTBEAT_TIMEOUT_S: Final = 30.0
_CHECK_PERIOD_S: Final = 0.2
_ANSWER_S: Final = 2.0
_TRIES: Final = 3
_SPEEDUP: Final = "SIM_SPEEDUP"
_AWAITED: Final = {False: "no heartbeat", True: "no position estimate"}


def missing(vehicle: Vehicle) -> str:
    """Return what a vehicle that is not ready has not said yet, in words."""
    return _AWAITED[vehicle.telemetry.heartbeat is not None]


async def until_all_ready(
    sitl: Sitl,
    vehicles: Mapping[str, Vehicle],
    require_running: Callable[[str], None],
    ready: Callable[[str], None] = lambda _name: None,
) -> None:
    """Return when every vehicle just started can fly, in real time; `ready` hears of each by name.

    Raises, in a group, VehicleError for one that does not become ready, and what `require_running` raises for one whose
    process has ended.
    """

    async def wait(name: str, vehicle: Vehicle) -> None:
        await until_ready(sitl, vehicle, lambda: require_running(name))
        ready(name)

    async with asyncio.TaskGroup() as group:
        for name, vehicle in vehicles.items():
            group.create_task(wait(name, vehicle))


async def until_ready(sitl: Sitl, vehicle: Vehicle, require_running: Callable[[], None]) -> None:
    """Return when one vehicle just started can fly, in real time. Errors as of `until_all_ready`."""
    async with background(_watch(require_running), _heartbeats(vehicle, sitl.start_speedup)):
        await vehicle.wait_until(
            lambda: vehicle.telemetry.heartbeat is not None,
            HEARTBEAT_TIMEOUT_S,
            "heartbeat",
            "See what its simulator says in its log.",
        )
        await autopilot_of(vehicle).prepare(vehicle)
        if sitl.start_speedup != 1.0:
            await _slow_down(vehicle)


async def _watch(require_running: Callable[[], None]) -> None:
    while True:
        require_running()
        await asyncio.sleep(_CHECK_PERIOD_S)


async def _heartbeats(vehicle: Vehicle, speedup: float) -> None:
    """Beat once in each second of the simulator's time; the link itself does in each of ours."""
    while speedup != 1.0:
        vehicle.link.post(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
            )
        )
        await vehicle.clock.sleep(1.0 / speedup)


async def _slow_down(vehicle: Vehicle) -> None:
    """Set the simulator to real time, and believe only the value it tells."""
    told: list[float] = []

    def take(message: Message) -> None:
        if message.param_id == _SPEEDUP:
            told.append(message.param_value)

    request = mavlink.MAVLink_param_set_message(
        vehicle.system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, _SPEEDUP.encode(), 1.0, mavlink.MAV_PARAM_TYPE_REAL32
    )
    with vehicle.hearing(mavlink.MAVLINK_MSG_ID_PARAM_VALUE, take):
        for _ in range(_TRIES):
            vehicle.link.post(request)
            if await vehicle.holds_within(_ANSWER_S, lambda: bool(told) and told[-1] == 1.0):
                return
    raise vehicle.failure("does not confirm SIM_SPEEDUP 1: it may fly faster than real time", "Start it once more.")
