"""What one vehicle tells when it is asked, gathered for the checks: nothing is armed, no mode or parameter changed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import VehicleError
from drivers.mavlink.autopilots import autopilot_of
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.identity import Identity, read_identities
from drivers.mavlink.parameters import read_parameters
from drivers.mavlink.timesync import ClockOffset, measure_clock
from drivers.mavlink.vehicle import Battery, Vehicle
from gcs.preflight.expected import Expected

HEARTBEAT_TIMEOUT_S: Final = 30.0
SILENT_S: Final = 10.0
"""An autopilot has a heartbeat each second: one not heard for so long is not there any more."""
_LOOK_S: Final = 1.0
COMPLAINTS_S: Final = 2.5
"""How long after its pre-arm checks an autopilot is listened to: their texts come at once, its health each second."""

Progress = Callable[[str, str], None]
"""Gets the name of the check that is waited for, and for what."""


@dataclass(frozen=True)
class PreArm:
    """What an autopilot's own checks came to."""

    complaints: tuple[str, ...]
    healthy: bool
    """Whether it calls itself ready to arm afterwards."""
    not_run: str = ""
    """Why its checks could not be run."""


@dataclass(frozen=True)
class VehicleFacts:
    """One vehicle as it is before the flight, and what it should be."""

    name: str
    expected: Expected
    autopilot: Autopilot
    identities: frozenset[Identity]
    contested: bool
    """Whether two autopilots claim its system id on one link."""
    missing_messages: tuple[str, ...]
    not_ready: str
    """Why it has no position estimate; empty when it has one."""
    armed: bool
    pre_arm: PreArm | None
    """None when it is armed already."""
    battery: Battery | None
    clock: ClockOffset | None
    parameters: Mapping[str, float]
    height_m: float | None
    """Above its home."""
    home_altitude_m: float | None
    """Above mean sea level."""
    place: complex | None
    """North + i east of the site's origin, m."""


async def gather_facts(vehicle: Vehicle, expected: Expected, progress: Progress) -> VehicleFacts:
    """Ask a vehicle for everything the checks look at.

    VehicleError when it is not heard, or nothing that can be flown; `progress` has then been told at which check.
    """
    progress("heartbeat", "waiting for a heartbeat")
    if not await vehicle.holds_within(HEARTBEAT_TIMEOUT_S, lambda: vehicle.telemetry.heartbeat is not None):
        others = ", ".join(map(str, sorted(vehicle.link.heard_system_ids)))
        raise vehicle.failure(
            f"no heartbeat of system id {vehicle.system_id} within {HEARTBEAT_TIMEOUT_S:g} s"
            + (f", but of {others}" if others else ""),
            "Check the link's address and system id, and that the autopilot runs.",
        )
    progress("autopilot", "asking what it is")
    autopilot = autopilot_of(vehicle, expected.autopilot)
    return await _while_heard(vehicle, _ask(vehicle, expected, autopilot, progress))


async def _while_heard(vehicle: Vehicle, asking: Coroutine[Any, Any, VehicleFacts]) -> VehicleFacts:
    """Return what comes of asking a vehicle; VehicleError as soon as it has fallen silent."""
    task = asyncio.ensure_future(asking)
    try:
        while not task.done():
            if vehicle.silent_for_s() > SILENT_S:
                raise vehicle.failure(
                    f"it fell silent: nothing was heard of it for {SILENT_S:g} s", "Check its power, and its link."
                )
            tick = asyncio.ensure_future(vehicle.clock.sleep(_LOOK_S))
            await asyncio.wait((task, tick), return_when=asyncio.FIRST_COMPLETED)
            tick.cancel()
        return task.result()
    finally:
        task.cancel()


async def _ask(vehicle: Vehicle, expected: Expected, autopilot: Autopilot, progress: Progress) -> VehicleFacts:
    progress("estimator", "waiting for its position estimate")
    async with asyncio.TaskGroup() as group:
        identities = group.create_task(read_identities(vehicle))
        clock = group.create_task(measure_clock(vehicle))
        parameters = group.create_task(
            read_parameters(vehicle, autopilot.parameters.reads, autopilot.parameters.value_of)
        )
        not_ready = group.create_task(_not_ready(vehicle, autopilot))
    progress("pre-arm", "listening to its own checks")
    armed = vehicle.armed
    pre_arm = None if armed else await _pre_arm(vehicle, autopilot)
    telemetry = vehicle.telemetry
    height_m = telemetry.relative_altitude_m
    position = None if telemetry.kinematics is None else telemetry.kinematics.position
    return VehicleFacts(
        name=vehicle.name,
        expected=expected,
        autopilot=autopilot,
        identities=identities.result(),
        contested=vehicle.system_id in vehicle.link.contested_system_ids,
        missing_messages=tuple(mavlink.mavlink_map[message_id].msgname for message_id in vehicle.rates.missing),
        not_ready=not_ready.result(),
        armed=armed,
        pre_arm=pre_arm,
        battery=telemetry.battery,
        clock=clock.result(),
        parameters=parameters.result(),
        height_m=height_m,
        home_altitude_m=None if position is None or height_m is None else position.altitude_m - height_m,
        place=None if position is None else expected.site.from_geodetic(position)[0],
    )


async def _not_ready(vehicle: Vehicle, autopilot: Autopilot) -> str:
    """Wait until the autopilot is ready, and return why it is not."""
    try:
        await autopilot.prepare(vehicle)
    except VehicleError as error:
        return error.problem
    return ""


async def _pre_arm(vehicle: Vehicle, autopilot: Autopilot) -> PreArm:
    """Run the autopilot's own checks and collect what it complains about.

    ArduCopter 4.6.3 looks only at what its present mode needs: on the ground in STABILIZE, GPS may be lost without a
    complaint. Its texts come within milliseconds, before the acknowledgement or after it; PX4 1.17's likewise.
    """
    texts: list[str] = []
    not_run = ""
    vehicle.on_text.append(texts.append)
    try:
        try:
            await vehicle.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS, what="its own pre-arm checks")
        except VehicleError as error:
            not_run = error.problem
        await vehicle.clock.sleep(COMPLAINTS_S)
    finally:
        vehicle.on_text.remove(texts.append)
    complaints = tuple(dict.fromkeys(text for text in texts if text.startswith(autopilot.complaint)))
    healthy = bool(vehicle.telemetry.sensors_healthy & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
    return PreArm(complaints, healthy, not_run)
