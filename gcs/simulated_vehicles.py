"""The vehicles of a playbook that are simulated: where each starts, the air it flies in, and how they are started."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final
from zlib import crc32

from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import CopterSpec, ProcessGroup, SimulatedTime, this_pid
from drivers.simulation.sitl import Sitl, SitlVehicle
from drivers.simulation.sitl_readiness import until_all_ready
from drivers.simulation.weather import SimulatedWeather
from gcs.playbook.schema import Playbook
from planner.frames import GeodeticPosition, SiteFrame

NO_PORTS: Final[Mapping[str, int]] = MappingProxyType({})


def homes_of(playbook: Playbook) -> dict[str, GeodeticPosition]:
    """Return where each UAV starts, by name; its system id is its place in this order, counted from 1."""
    site, frame = SiteFrame(playbook.site.origin), playbook.site.frame
    return {name: site.to_geodetic(frame.to_site(start)) for name, start in playbook.uavs.items()}


def weather_of(playbook: Playbook) -> SimulatedWeather:
    """Return the air that simulated vehicles fly in."""
    air = playbook.simulation
    return SimulatedWeather(air.wind_mps, math.radians(air.wind_from_deg), air.gusts_mps, air.gps_noise_m)


def sitl_vehicles_of(
    playbook: Playbook, vehicles: Mapping[str, Vehicle], sitl: Sitl, ports: Mapping[str, int] = NO_PORTS
) -> list[SitlVehicle]:
    """Return what an autopilot's own simulator is to fly, each speaking to the link of its vehicle, or to its port."""
    homes, weather, station_id = homes_of(playbook), weather_of(playbook), playbook.mavlink.system_id
    spoken_to = {name: at.link.address.port for name, at in vehicles.items()} | dict(ports)
    return [
        SitlVehicle(name, at.system_id, spoken_to[name], homes[name], weather, station_id, sitl.start_speedup)
        for name, at in vehicles.items()
    ]


async def start_vehicles(
    playbook: Playbook,
    vehicles: Mapping[str, Vehicle],
    group: ProcessGroup,
    time: SimulatedTime,
    sitl: Sitl | None,
    ports: Mapping[str, int] = NO_PORTS,
) -> None:
    """Start an embedded copter, or else an autopilot's own simulator, for every vehicle, at its start.

    Each speaks to the link of its vehicle, or to the port of `ports` that somebody passes on from.
    SimulationError or VehicleError, in a group, for what does not come up.
    """
    if sitl is not None:
        for simulated in sitl_vehicles_of(playbook, vehicles, sitl, ports):
            await sitl.start(simulated, group)
        await until_all_ready(sitl, vehicles, group.require_running)
        return
    weather, station_id = weather_of(playbook), playbook.mavlink.system_id
    for name, home in homes_of(playbook).items():
        at = vehicles[name]
        port = ports.get(name, at.link.address.port)
        nose_deg = crc32(name.encode()) % 360.0 if playbook.sensor.reference == "body" else 0.0
        copter = CopterSpec(
            name, at.system_id, port, home, heading_deg=nose_deg, weather=weather, station_id=station_id
        )
        await group.start(name, copter.arguments(time, this_pid()))
