"""The fleet of a run: every vehicle checked, brought into guided flight, and streamed to."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Protocol

from drivers.clock import Clock
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.checks import Verdict
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits, StreamState
from drivers.mavlink.vehicle import Vehicle
from drivers.tasks import StartTask
from gcs.nodes.remote_stream import RemoteStream
from gcs.playbook.schema import Playbook
from gcs.preflight.run import preflight
from gcs.relay.executor import ReleasableLease
from planner.plan import RelayPlan

NOWHERE_ELSE: Final[Mapping[str, RemoteStream]] = MappingProxyType({})


class Stream(ReleasableLease, Protocol):
    """A vehicle's setpoint stream, here or at a link node."""

    async def run(self) -> None:
        """Stream until cancelled."""
        ...


@dataclass(frozen=True)
class Member:
    """One vehicle of the fleet, the strategy that flies it, and its setpoint stream."""

    vehicle: Vehicle
    autopilot: Autopilot
    stream: Stream


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


async def bring_up(
    playbook: Playbook,
    vehicles: Mapping[str, Vehicle],
    autopilots: Mapping[str, Autopilot],
    clock: Clock,
    start: StartTask,
    members: dict[str, Member],
    elsewhere: Mapping[str, RemoteStream] = NOWHERE_ELSE,
) -> None:
    """Bring every vehicle into guided flight at the playbook's altitude; each is a member as soon as its stream runs.

    Those `elsewhere` are brought up by their link nodes, which stream to them.

    VehicleError, in a group, naming the one that refuses. The streams are silent, or hold, until a lease is first
    renewed. When they end, a vehicle whose guided flight ends with its stream is left in a hold of its own.
    """
    limits = StreamLimits(lease_s=playbook.flight.lease_s, largest_speed_mps=playbook.flight.speed_mps)

    async def bring_up_one(name: str, vehicle: Vehicle) -> None:
        autopilot = autopilots[name]
        if name in elsewhere:
            await elsewhere[name].bring_up()
            stream: Stream = elsewhere[name]
        else:
            await autopilot.take_off(vehicle, playbook.flight.altitude_m)
            stream = SetpointStreamer(vehicle, autopilot, playbook.flight.altitude_m, limits, clock)
        members[name] = Member(vehicle, autopilot, stream)
        start(stream_for(members[name]))

    async with asyncio.TaskGroup() as group:
        for name, vehicle in vehicles.items():
            group.create_task(bring_up_one(name, vehicle))


async def stream_for(member: Member) -> None:
    """Run a vehicle's stream until cancelled; one that needs it is then left in a hold that needs none."""
    try:
        await member.stream.run()
    finally:
        needs_stream = member.autopilot.stream.idle_setpoint is not None
        if needs_stream and member.stream.state is not StreamState.PILOT:
            member.autopilot.hold(member.vehicle)
