"""Injected faults strike real processes, and only those that a run has started itself."""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Ailment, SensorFault, decode
from drivers.simulation.commands import FORCE_REBOOT
from drivers.simulation.impairment import UNIMPAIRED, Impairment
from drivers.simulation.launcher import process_group
from gcs.errors import ServiceError
from gcs.playbook.stages import Inject
from gcs.stages.simulation import ROUTER, End, Simulation
from tests.fakes import FakeBus

KEYS = SwarmKeys("bench")


def state_of(pid: int) -> str:
    """What the kernel calls the state of a process: S sleeps, T is stopped."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


async def until_state(pid: int, states: str) -> None:
    async with asyncio.timeout(20.0):
        while state_of(pid) not in states:  # noqa: ASYNC110 - the kernel tells nobody
            await asyncio.sleep(0.01)


def inject(fault: str, vehicle: str | None = None, **more: float | str) -> Inject:
    return Inject.model_validate({"fault": fault, "vehicle": vehicle} | more)


@pytest.mark.slow
async def test_a_process_is_frozen_and_thawed_and_so_is_the_router_which_is_killed(tmp_path: Path) -> None:
    async with process_group(tmp_path) as group:
        for name in ("U1", ROUTER):
            await group.start(name, ["-c", "import time; time.sleep(60)"])
        simulation = Simulation(group, FakeBus(), KEYS)
        pid = group.processes["U1"].pid
        thaw = await simulation.strike(inject("freeze", "U1"))
        await until_state(pid, "T")
        await thaw()
        await until_state(pid, "SDR")
        thaw = await simulation.strike(inject("router_frozen"))
        await until_state(group.processes[ROUTER].pid, "T")
        await thaw()
        await until_state(group.processes[ROUTER].pid, "SDR")
        first = group.processes[ROUTER]
        back = await simulation.strike(inject("router_killed"))
        assert await asyncio.wait_for(first.wait(), 5.0) == -9
        with pytest.raises(ServiceError, match="bus-router has ended already"):
            await simulation.strike(inject("router_killed"))
        with pytest.raises(ServiceError, match="process of L1 has ended already, or is not this run's own"):
            await simulation.strike(inject("freeze", "L1"))
        await back()
        assert group.processes[ROUTER].pid != first.pid
        await until_state(group.processes[ROUTER].pid, "SDR")


STOPPED = """
import asyncio, sys, time
from pathlib import Path
from drivers.bus.keys import SwarmKeys
from drivers.simulation.launcher import process_group
from gcs.playbook.stages import Inject
from gcs.stages.simulation import Simulation

async def main():
    async with process_group(Path(sys.argv[1])) as group:
        simulation = Simulation(group, None, SwarmKeys("bench"), speedup=4.0)
        await simulation.strike(Inject(fault=sys.argv[2], for_s=4.0))
        began_s, longest_s = time.monotonic(), 0.0
        while longest_s < 0.8 and time.monotonic() - began_s < 20.0:
            before_s = time.monotonic()
            await asyncio.sleep(0.01)
            longest_s = max(longest_s, time.monotonic() - before_s)
        print(longest_s)

asyncio.run(main())
"""


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["service_frozen", "service_killed"])
async def test_the_service_itself_stands_still_for_its_time_or_is_killed(tmp_path: Path, fault: str) -> None:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", STOPPED, str(tmp_path), fault), stdout=asyncio.subprocess.PIPE
    )
    said, _ = await asyncio.wait_for(process.communicate(), 60.0)
    if fault == "service_killed":
        assert (process.returncode, said) == (-9, b"")
    else:
        assert process.returncode == 0
        assert float(said) > 0.8


def wrong(ailment: Ailment) -> SensorFault:
    return SensorFault(silent=False, ailments=[ailment])


async def told_after(tmp_path: Path, *strikes: Inject) -> tuple[list[End], FakeBus]:
    bus = FakeBus()
    async with process_group(tmp_path) as group:
        simulation = Simulation(group, bus, KEYS)
        ends = [await simulation.strike(stage) for stage in strikes]
    return ends, bus


def last_told(bus: FakeBus, name: str) -> SensorFault:
    return decode(bus.payloads(KEYS.sensor_fault(name))[-1], SensorFault)


async def test_a_sensor_falls_silent_by_its_own_key_and_speaks_again(tmp_path: Path) -> None:
    (end,), bus = await told_after(tmp_path, inject("sensor_silent", "U2"))
    assert last_told(bus, "U2") == SensorFault(silent=True)
    await end()
    assert last_told(bus, "U2") == SensorFault(silent=False)
    assert {key for key, _ in bus.sent} == bus.reliable_keys == {KEYS.sensor_fault("U2")}


@pytest.mark.parametrize(
    ("stage", "told"),
    [
        (inject("sensor_stuck", "U1"), wrong(Ailment("sensor_stuck"))),
        (inject("sensor_bias", "U1", bias_deg=90), wrong(Ailment("sensor_bias", math.pi / 2))),
        (inject("sensor_jump", "U1", jump_deg=-180, of="L0"), wrong(Ailment("sensor_jump", -math.pi, "L0"))),
        (inject("clock_step", "U1", step_s=-2), wrong(Ailment("clock_step", -2.0))),
        (inject("clock_drift", "U1", drift_ppm=500), wrong(Ailment("clock_drift", 5e-4))),
        (
            inject("report_faults", "U1", loss=0.1, duplication=0.2, reordering=0.3, delay_s=0.4, jitter_s=0.5),
            SensorFault(silent=False, loss=0.1, duplication=0.2, reordering=0.3, delay_s=0.4, jitter_s=0.5),
        ),
        (inject("transmitter_silent", "U1"), SensorFault(silent=False, muted=True)),
    ],
)
async def test_each_fault_of_a_sensor_is_told_as_it_is(tmp_path: Path, stage: Inject, told: SensorFault) -> None:
    _, bus = await told_after(tmp_path, stage)
    assert last_told(bus, "U1") == told


async def test_faults_of_one_sensor_add_up_and_each_ends_alone(tmp_path: Path) -> None:
    biased = inject("sensor_bias", "U1", bias_deg=90)
    late, lossy = inject("report_faults", "U1", delay_s=0.2), inject("report_faults", "U1", loss=0.5, delay_s=0.1)
    ends, bus = await told_after(tmp_path, biased, late, inject("sensor_silent", "U1"), lossy)
    turned = [Ailment("sensor_bias", math.pi / 2)]
    assert last_told(bus, "U1") == SensorFault(silent=True, ailments=turned, loss=0.5, delay_s=0.2)
    await ends[1]()
    assert last_told(bus, "U1") == SensorFault(silent=True, ailments=turned, loss=0.5, delay_s=0.1)
    for number in (2, 3, 0):
        await ends[number]()
    assert last_told(bus, "U1") == SensorFault(silent=False)


async def test_a_full_disk_takes_nothing_until_it_is_free_again(tmp_path: Path) -> None:
    async with process_group(tmp_path) as group:
        simulation = Simulation(group, FakeBus(), KEYS)
        (tmp_path / "before").write_text("kept")
        ends = [await simulation.strike(inject("disk_full")) for _ in range(2)]
        try:
            with pytest.raises(OSError, match="File too large"):
                (tmp_path / "new").write_text("lost")
            await ends[0]()
            with pytest.raises(OSError, match="File too large"), (tmp_path / "before").open("a") as file:
                file.write("lost")
        finally:
            await ends[1]()
        (tmp_path / "new").write_text("written")
    assert [(tmp_path / name).read_text() for name in ("before", "new")] == ["kept", "written"]


class Tap:
    """What a tap on a link was told and asked to say."""

    def __init__(self) -> None:
        self.system_id = 7
        self.cut = False
        self.mute = False
        self.impairment = UNIMPAIRED
        self.said_again: bytes | None = None
        self.said: list[mavlink.MAVLink_message] = []
        self._codec = mavlink.MAVLink(None)

    def speak(self, frame: bytes) -> None:
        self.said += self._codec.parse_buffer(bytearray(frame)) or []

    def keep_saying(self, frame: bytes | None) -> None:
        self.said_again = frame


@pytest.fixture
async def tap(tmp_path: Path) -> AsyncIterator[tuple[Tap, Simulation]]:
    async with process_group(tmp_path) as group:
        tap = Tap()
        yield tap, Simulation(group, FakeBus(), KEYS, {"U1": tap})


async def test_a_link_fails_as_it_is_told_and_is_good_again(tap: tuple[Tap, Simulation]) -> None:
    end = await tap[1].strike(inject("link_faults", "U1", loss=0.3, delay_s=0.2))
    assert tap[0].impairment == Impairment(loss=0.3, delay_s=0.2)
    await end()
    assert tap[0].impairment == UNIMPAIRED
    for fault, what in (("link_cut", "cut"), ("telemetry_lost", "mute")):
        end = await tap[1].strike(inject(fault, "U1"))
        assert getattr(tap[0], what)
        await end()
        assert not getattr(tap[0], what)


async def test_an_autopilot_is_rebooted_in_the_air_by_another_station(tap: tuple[Tap, Simulation]) -> None:
    await (await tap[1].strike(inject("reboot", "U1")))()
    (told,) = tap[0].said
    assert (told.get_type(), told.command, told.target_system) == (
        "COMMAND_LONG", mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 7,
    )  # fmt: skip
    assert (told.param1, told.param6) == (1, FORCE_REBOOT)
    assert told.get_srcSystem() != 255


async def test_a_battery_is_drained_and_full_again(tap: tuple[Tap, Simulation]) -> None:
    await (await tap[1].strike(inject("battery_low", "U1")))()
    assert [(told.get_type(), told.param_id, told.param_value, told.target_system) for told in tap[0].said] == [
        ("PARAM_SET", "BATT_CAPACITY", 1.0, 7),
        ("PARAM_SET", "BATT_CAPACITY", 5000.0, 7),
    ]


async def test_a_pilot_keeps_what_he_has_taken(tap: tuple[Tap, Simulation]) -> None:
    await (await tap[1].strike(inject("pilot", "U1")))()
    assert [told.command for told in tap[0].said] == [mavlink.MAV_CMD_DO_SET_MODE]


async def test_another_station_flies_a_transmitter_off_by_velocities_alone_until_it_ends(
    tap: tuple[Tap, Simulation],
) -> None:
    end = await tap[1].strike(inject("transmitter_drift", "U1", speed_mps=2, course_deg=90))
    tap[0].speak(tap[0].said_again or b"")
    (told,) = tap[0].said
    assert (told.get_type(), told.target_system) == ("SET_POSITION_TARGET_LOCAL_NED", 7)
    assert (told.vx, told.vy, told.vz) == pytest.approx((0.0, 2.0, 0.0), abs=1e-6)
    assert told.get_srcSystem() != 255
    await end()
    assert tap[0].said_again is None
