"""The AOA sensors of simulated UAVs: one process of them, told what the playbook says."""

from __future__ import annotations

import math

import msgspec

from drivers.aoa.simulated import SensorSettings
from drivers.simulation.launcher import ProcessGroup, SimulatedTime, this_pid
from gcs.playbook.schema import Playbook


async def start_sensors(
    playbook: Playbook, seed: int, group: ProcessGroup, endpoint: str, sim_time: SimulatedTime
) -> None:
    """Start the sensors of every receiver; SimulationError when their process cannot be started."""
    frame, sensor = playbook.site.frame, playbook.sensor
    sites = {name: frame.to_site(place) for name, place in playbook.beacons.items()}
    settings = SensorSettings(
        swarm=playbook.name,
        endpoint=endpoint,
        receivers=list(playbook.receivers),
        beacons={name: (site.real, site.imag) for name, site in sites.items()},
        sigma_rad=math.radians(sensor.sigma_deg),
        rate_hz=sensor.rate_hz,
        latency_s=sensor.latency_s,
        drop_out=sensor.drop_out,
        seed=seed,
        speedup=sim_time.speedup,
        epoch_ns=sim_time.epoch_ns,
        parent_pid=this_pid(),
        reference=sensor.reference,
        faults={name: sensor.faults.of(name) for name in playbook.receivers},
        keys=playbook.bus.keys,
        insecure=playbook.bus.insecure,
        resolution_rad=math.radians(sensor.resolution_deg),
    )
    await group.start("sensors", ["-m", "drivers.aoa.simulated"], stdin=msgspec.json.encode(settings))
