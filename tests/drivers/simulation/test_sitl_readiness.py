"""Simulated autopilots are waited for: until they can fly in real time, or it is known why one cannot."""

import sys
import time
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.errors import SimulationError, VehicleError
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import open_link
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import process_group
from drivers.simulation.sitl import SITLS, SitlVehicle
from drivers.simulation.sitl_readiness import missing, until_all_ready
from gcs.errors import leaves
from planner.frames import GeodeticPosition

pytestmark = pytest.mark.slow

HOME = GeodeticPosition(-35.363262, 149.165237, 584.0)
SITL = SITLS["ardupilot"]


@pytest.fixture
def ready_within(monkeypatch, tmp_path):
    """Start a stand-in for ArduCopter's simulator with a fault, wait for it, and return it with who became ready."""
    program = tmp_path / "arducopter"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} {Path(__file__).with_name("fake_arducopter.py")} "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("ARDUCOPTER", str(program))

    async def wait(fault, speedup=1.0):
        monkeypatch.setenv("FAKE", f"7={fault}")
        clock, ready = SystemClock(speedup), []
        async with (
            open_link(LinkAddress("udpin", "127.0.0.1", 0), Codec(), clock) as link,
            process_group(tmp_path) as group,
        ):
            vehicle = Vehicle("U7", 7, link, clock)
            assert missing(vehicle) == "no heartbeat"
            spec = SitlVehicle("U7", 7, link.address.port, HOME, speedup=SITL.start_speedup)
            await SITL.start(spec, group)
            await until_all_ready(SITL, {"U7": vehicle}, group.require_running, ready.append)
            began_ms, began_s = await boot_ms(vehicle), time.monotonic()
            assert missing(vehicle) == "no position estimate"
            while time.monotonic() - began_s < 1.0:
                passed_ms = await boot_ms(vehicle) - began_ms
            return ready, passed_ms / 1e3 / (time.monotonic() - began_s)

    return wait


async def boot_ms(vehicle):
    told = []
    with vehicle.hearing(33, lambda message: told.append(message.time_boot_ms)):
        await vehicle.wait_until(lambda: bool(told), 5.0, "position", "")
    return told[-1]


async def failure(waiting):
    with pytest.raises(ExceptionGroup) as caught:
        await waiting
    (error,) = leaves(caught.value)
    return error


async def test_a_ready_vehicle_s_time_runs_at_its_real_rate(ready_within):
    ready, rate = await ready_within("none")
    assert ready == ["U7"]
    assert 0.2 < rate < 2.0, "slower only by what a busy machine takes away; it started ten times as fast"


async def test_a_simulator_that_ends_is_an_error_with_its_last_words_at_once(ready_within):
    error = await failure(ready_within("dead"))
    assert isinstance(error, SimulationError)
    assert str(error) == "the process of U7 ended with status 1: PANIC: no airframe"


@pytest.mark.parametrize(
    ("fault", "complaint"),
    [
        ("silent", "no heartbeat within 30 s"),
        ("lost", "no position estimate within 90 s"),
        ("fast", "does not confirm SIM_SPEEDUP 1: it may fly faster than real time"),
    ],
)
async def test_one_that_does_not_become_ready_is_named_with_what_it_has_not_said(ready_within, fault, complaint):
    error = await failure(ready_within(fault, speedup=20.0))
    assert isinstance(error, VehicleError)
    assert error.vehicle == "U7"
    assert complaint in str(error)
