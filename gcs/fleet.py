"""The fleet of a run: every vehicle checked, brought into guided flight, and streamed to."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.checks import Verdict
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits, StreamState
from drivers.mavlink.vehicle import Vehicle
from drivers.tasks import open_background
from gcs.playbook.schema import Playbook
from gcs.preflight.run import preflight
from planner.plan import RelayPlan


@dataclass(frozen=True)
class Member:
    """One vehicle of the fleet, the strategy that flies it, and its setpoint stream."""

    vehicle: Vehicle
    autopilot: Autopilot
    stream: SetpointStreamer


async def cleared_to_arm(
    playbook: Playbook, plan: RelayPlan, vehicles: Mapping[str, Vehicle], say: Callable[[str], None]
) -> Mapping[str, Autopilot]:
    """Check the whole fleet before anything is armed; return the strategy that flies each vehicle.

    `say` gets what is not as it should be. PreflightError when something is wrong that nothing may be armed with.
    """
    report = await preflight(vehicles, playbook, plan)
    for line in report.lines(Verdict.SOFT):
        say(f"preflight: {line}")
    report.require()
    return report.autopilots


@contextlib.asynccontextmanager
async def in_guided_flight(
    playbook: Playbook, vehicles: Mapping[str, Vehicle], autopilots: Mapping[str, Autopilot], clock: Clock
) -> AsyncIterator[dict[str, Member]]:
    """Bring every vehicle into guided flight at the playbook's altitude and yield them, each with its stream running.

    VehicleError naming the one that refuses. The streams are silent, or hold, until a lease is first renewed. They end
    with the block; where guided flight ends with its stream, the vehicle is then left in a hold of its own.
    """
    limits = StreamLimits(lease_s=playbook.flight.lease_s, largest_speed_mps=playbook.flight.speed_mps)

    async def bring_up(vehicle: Vehicle, autopilot: Autopilot) -> Member:
        await autopilot.take_off(vehicle, playbook.flight.altitude_m)
        stream = SetpointStreamer(vehicle, autopilot, playbook.flight.altitude_m, limits, clock)
        member = Member(vehicle, autopilot, stream)
        start(stream_for(member))
        return member

    async with open_background() as start:
        async with asyncio.TaskGroup() as group:
            tasks = {name: group.create_task(bring_up(vehicle, autopilots[name])) for name, vehicle in vehicles.items()}
        yield {name: task.result() for name, task in tasks.items()}


async def stream_for(member: Member) -> None:
    """Run a vehicle's stream until cancelled; one that needs it is then left in a hold that needs none."""
    try:
        await member.stream.run()
    finally:
        needs_stream = member.autopilot.stream.idle_setpoint is not None
        if needs_stream and member.stream.state is not StreamState.PILOT:
            member.autopilot.hold(member.vehicle)
