"""The fleet of a run: every vehicle behind its link, embedded copters started where the playbook names no links."""

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
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import CopterSpec, ProcessGroup, SimulatedTime, this_pid
from gcs.playbook.schema import Playbook
from planner.frames import SiteFrame

HEARTBEAT_TIMEOUT_S = 30.0


@dataclass(frozen=True)
class Member:
    """One vehicle of the fleet and the strategy that flies it."""

    vehicle: Vehicle
    autopilot: Autopilot


@contextlib.asynccontextmanager
async def open_links(playbook: Playbook, clock: Clock) -> AsyncIterator[dict[str, Vehicle]]:
    """Open every link of the playbook; yield the vehicles by name. Embedded copters get a free port each."""
    async with contextlib.AsyncExitStack() as stack:
        links: dict[str, Link] = {}
        vehicles: dict[str, Vehicle] = {}
        for system_id, name in enumerate(playbook.uavs, start=1):
            if playbook.vehicles is None:
                link = await stack.enter_async_context(open_link(LinkAddress("udpin", "127.0.0.1", 0), Codec(), clock))
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


async def start_copters(
    playbook: Playbook, vehicles: dict[str, Vehicle], group: ProcessGroup, time: SimulatedTime
) -> None:
    """Start an embedded copter for every vehicle, at its start."""
    site, frame = SiteFrame(playbook.site.origin), playbook.site.frame
    for name, start in playbook.uavs.items():
        vehicle = vehicles[name]
        spec = CopterSpec(name, vehicle.system_id, vehicle.link.address.port, site.to_geodetic(frame.to_site(start)))
        await group.start(name, spec.arguments(time, this_pid()))


async def take_off(playbook: Playbook, vehicles: dict[str, Vehicle]) -> dict[str, Member]:
    """Bring every vehicle into guided flight at the playbook's altitude. VehicleError naming the one that refuses."""

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
        return Member(vehicle, autopilot)

    async with asyncio.TaskGroup() as group:
        tasks = {name: group.create_task(bring_up(vehicle)) for name, vehicle in vehicles.items()}
    return {name: task.result() for name, task in tasks.items()}


def open_streams(playbook: Playbook, members: dict[str, Member], clock: Clock) -> dict[str, SetpointStreamer]:
    """Return a setpoint streamer for every receiver, silent until its lease is first renewed."""
    limits = StreamLimits(lease_s=playbook.flight.lease_s, largest_speed_mps=playbook.flight.speed_mps)
    return {
        name: SetpointStreamer(
            members[name].vehicle, members[name].autopilot, playbook.flight.altitude_m, limits, clock
        )
        for name in playbook.receivers
    }
