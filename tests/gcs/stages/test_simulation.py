"""Injected faults strike real processes, and only those that a run has started itself."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import SensorFault, decode
from drivers.simulation.launcher import process_group
from gcs.errors import ServiceError
from gcs.stages.simulation import ROUTER, Simulation
from tests.fakes import FakeBus

KEYS = SwarmKeys("bench")


def state_of(pid: int) -> str:
    """What the kernel calls the state of a process: S sleeps, T is stopped."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


@pytest.mark.slow
async def test_a_process_is_frozen_and_thawed_and_the_router_killed(tmp_path: Path) -> None:
    async with process_group(tmp_path) as group:
        for name in ("U1", ROUTER):
            await group.start(name, ["-c", "import time; time.sleep(60)"])
        simulation = Simulation(group, FakeBus(), KEYS)
        pid = group.processes["U1"].pid
        thaw = simulation.strike("freeze", "U1")
        await asyncio.sleep(0.1)
        assert state_of(pid) == "T"
        thaw()
        await asyncio.sleep(0.1)
        assert state_of(pid) in "SR"
        simulation.strike("router_killed", None)
        assert await asyncio.wait_for(group.processes[ROUTER].wait(), 5.0) == -9
        with pytest.raises(ServiceError, match="bus-router has ended already"):
            simulation.strike("router_killed", None)
        with pytest.raises(ServiceError, match="process of L1 has ended already, or is not this run's own"):
            simulation.strike("freeze", "L1")


async def test_a_sensor_falls_silent_by_its_own_key_and_speaks_again(tmp_path: Path) -> None:
    bus = FakeBus()
    async with process_group(tmp_path) as group:
        Simulation(group, bus, KEYS).strike("sensor_silent", "U2")()
    told = [(key, decode(payload, SensorFault).silent) for key, payload in bus.sent]
    assert told == [(KEYS.sensor_fault("U2"), True), (KEYS.sensor_fault("U2"), False)]
