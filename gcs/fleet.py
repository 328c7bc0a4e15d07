"""The fleet of a run: every vehicle behind its link, simulated ones started where the playbook names no links."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.mavlink.autopilots import autopilot_of
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import Link, open_link
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits, StreamState
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import CopterSpec, ProcessGroup, SimulatedTime, this_pid
from drivers.simulation.sitl import Sitl, SitlVehicle
from drivers.tasks import open_background
from gcs.playbook.schema import Playbook
from planner.frames import SiteFrame

HEARTBEAT_TIMEOUT_S = 30.0


@dataclass(frozen=True)
class Member:
    """One vehicle of the fleet, the strategy that flies it, and its setpoint stream."""

    vehicle: Vehicle
    autopilot: Autopilot
    stream: SetpointStreamer


@contextlib.asynccontextmanager
async def open_links(playbook: Playbook, clock: Clock, sitl: Sitl | None) -> AsyncIterator[dict[str, Vehicle]]:
    """Open every link of the playbook; yield the vehicles by name. Simulated ones get a port each."""
    async with contextlib.AsyncExitStack() as stack:
        links: dict[str, Link] = {}
        vehicles: dict[str, Vehicle] = {}
        for system_id, name in enumerate(playbook.uavs, start=1):
            if playbook.vehicles is None:
                address = LinkAddress("udpin", "127.0.0.1", 0 if sitl is None else sitl.port(system_id))
                link = await stack.enter_async_context(open_link(address, Codec(), clock))
            else:
                at = playbook.vehicles[name]
                system_id = at.system_id  # noqa: PLW2901 - the playbook's own
                if at.link not in links:
                    links[at.link] = await stack.enter_async_context(
                        open_link(LinkAddress.parse(at.link), Codec(), clock)
                    )
                link = links[at.link]
            vehicles[name] = Vehicle(name, system_id, link, clock)
        yield vehicles


async def start_vehicles(
    playbook: Playbook, vehicles: dict[str, Vehicle], group: ProcessGroup, time: SimulatedTime, sitl: Sitl | None
) -> None:
    """Start an embedded copter, or else an autopilot's own simulator, for every vehicle, at its start."""
    site, frame = SiteFrame(playbook.site.origin), playbook.site.frame
    for name, start in playbook.uavs.items():
        system_id, port = vehicles[name].system_id, vehicles[name].link.address.port
        home = site.to_geodetic(frame.to_site(start))
        if sitl is None:
            await group.start(name, CopterSpec(name, system_id, port, home).arguments(time, this_pid()))
        else:
            await sitl.start(SitlVehicle(name, system_id, port, home), group)


@contextlib.asynccontextmanager
async def in_guided_flight(
    playbook: Playbook, vehicles: dict[str, Vehicle], clock: Clock
) -> AsyncIterator[dict[str, Member]]:
    """Bring every vehicle into guided flight at the playbook's altitude and yield them, each with its stream running.

    VehicleError naming the one that refuses. The streams are silent, or hold, until a lease is first renewed. They end
    with the block; where guided flight ends with its stream, the vehicle is then left in a hold of its own.
    """
    limits = StreamLimits(lease_s=playbook.flight.lease_s, largest_speed_mps=playbook.flight.speed_mps)

    async def bring_up(vehicle: Vehicle) -> Member:
        await vehicle.wait_until(
            lambda: vehicle.telemetry.heartbeat is not None,
            HEARTBEAT_TIMEOUT_S,
            "heartbeat",
            "Check the link's address and system id, and that the autopilot runs.",
        )
        autopilot = autopilot_of(vehicle)
        await autopilot.prepare(vehicle)
        await autopilot.take_off(vehicle, playbook.flight.altitude_m)
        stream = SetpointStreamer(vehicle, autopilot, playbook.flight.altitude_m, limits, clock)
        member = Member(vehicle, autopilot, stream)
        start(stream_for(member))
        return member

    async with open_background() as start:
        async with asyncio.TaskGroup() as group:
            tasks = {name: group.create_task(bring_up(vehicle)) for name, vehicle in vehicles.items()}
        yield {name: task.result() for name, task in tasks.items()}


async def stream_for(member: Member) -> None:
    """Run a vehicle's stream until cancelled; one that needs it is then left in a hold that needs none."""
    try:
        await member.stream.run()
    finally:
        needs_stream = member.autopilot.stream.idle_setpoint is not None
        if needs_stream and member.stream.state is not StreamState.PILOT:
            member.autopilot.hold(member.vehicle)
