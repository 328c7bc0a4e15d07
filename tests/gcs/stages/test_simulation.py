"""Injected faults strike real processes, and only those that a run has started itself."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import SensorFault, decode
from drivers.simulation.commands import FORCE_REBOOT
from drivers.simulation.impairment import UNIMPAIRED, Impairment
from drivers.simulation.launcher import process_group
from gcs.errors import ServiceError
from gcs.stages.simulation import ROUTER, Simulation
from tests.fakes import FakeBus

KEYS = SwarmKeys("bench")


def state_of(pid: int) -> str:
    """What the kernel calls the state of a process: S sleeps, T is stopped."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


async def until_state(pid: int, states: str) -> None:
    async with asyncio.timeout(20.0):
        while state_of(pid) not in states:  # noqa: ASYNC110 - the kernel tells nobody
            await asyncio.sleep(0.01)


@pytest.mark.slow
async def test_a_process_is_frozen_and_thawed_and_so_is_the_router_which_is_killed(tmp_path: Path) -> None:
    async with process_group(tmp_path) as group:
        for name in ("U1", ROUTER):
            await group.start(name, ["-c", "import time; time.sleep(60)"])
        simulation = Simulation(group, FakeBus(), KEYS)
        pid = group.processes["U1"].pid
        thaw = simulation.strike("freeze", "U1")
        await until_state(pid, "T")
        thaw()
        await until_state(pid, "SDR")
        thaw = simulation.strike("router_frozen", None)
        await until_state(group.processes[ROUTER].pid, "T")
        thaw()
        await until_state(group.processes[ROUTER].pid, "SDR")
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


class Tap:
    """What a tap on a link was told and asked to say."""

    def __init__(self) -> None:
        self.system_id = 7
        self.cut = False
        self.impairment = UNIMPAIRED
        self.said: list[mavlink.MAVLink_message] = []
        self._codec = mavlink.MAVLink(None)

    def speak(self, frame: bytes) -> None:
        self.said += self._codec.parse_buffer(bytearray(frame)) or []


@pytest.fixture
async def tap(tmp_path: Path) -> AsyncIterator[tuple[Tap, Simulation]]:
    async with process_group(tmp_path) as group:
        tap = Tap()
        yield tap, Simulation(group, FakeBus(), KEYS, {"U1": tap})


async def test_a_link_fails_as_it_is_told_and_is_good_again(tap: tuple[Tap, Simulation]) -> None:
    bad = Impairment(loss=0.3, delay_s=0.2)
    end = tap[1].strike("link_faults", "U1", bad)
    assert tap[0].impairment == bad
    end()
    assert tap[0].impairment == UNIMPAIRED
    end = tap[1].strike("link_cut", "U1")
    assert tap[0].cut
    end()
    assert not tap[0].cut


async def test_an_autopilot_is_rebooted_in_the_air_by_another_station(tap: tuple[Tap, Simulation]) -> None:
    tap[1].strike("reboot", "U1")()
    (told,) = tap[0].said
    assert (told.get_type(), told.command, told.target_system) == (
        "COMMAND_LONG", mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 7,
    )  # fmt: skip
    assert (told.param1, told.param6) == (1, FORCE_REBOOT)
    assert told.get_srcSystem() != 255


async def test_a_battery_is_drained_and_full_again(tap: tuple[Tap, Simulation]) -> None:
    tap[1].strike("battery_low", "U1")()
    assert [(told.get_type(), told.param_id, told.param_value, told.target_system) for told in tap[0].said] == [
        ("PARAM_SET", "BATT_CAPACITY", 1.0, 7),
        ("PARAM_SET", "BATT_CAPACITY", 5000.0, 7),
    ]


async def test_a_pilot_keeps_what_he_has_taken(tap: tuple[Tap, Simulation]) -> None:
    tap[1].strike("pilot", "U1")()
    assert [told.command for told in tap[0].said] == [mavlink.MAV_CMD_DO_SET_MODE]
