"""Real autopilots in their own simulators: relays form, a pilot has the last word, a service that has gone lets go.

Skipped without a program; a skip is not a pass.
"""

from __future__ import annotations

import asyncio
import json
import math
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import SimulationError
from drivers.simulation.sitl import SITLS, Sitl
from planner.frames import SiteFrame
from tests.gcs.field import Field, open_field

ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "sitl_configs"
PLAYBOOK = """\
playbook: 1
name: three
formation: {kind: custom, slots: {O1: [70, 60]}}
transmitters:
  L0: {at: [0, 0]}
  L1: {at: [100, 0]}
receivers:
  U1: {start: [20, 30]}
flight: {altitude_m: 6, speed_mps: 4}
"""
LETS_GO_S = 0.1
"""From the tap passing a heartbeat on to the service having read it."""
MODE_LAND_ARDUPILOT, MODE_LAND_PX4 = 9, 0x0604_0000
FORCED = 20190226
"""What makes ArduPilot reboot in flight."""


@dataclass(frozen=True)
class Real:
    """A real autopilot: its simulator, its modes, and how it is told of the mode a pilot's station asks for."""

    name: str
    guided: int
    pilots_mode: int
    pilots_parameters: tuple[float, ...]
    lands: int
    misses_station_s: float
    """After its station's last heartbeat: its parameter file's FS_GCS_TIMEOUT; COM_DL_LOSS_T and 5 s to think."""
    leaves_guided: bool
    """Whether it leaves its guided mode a second after the stream has ended."""

    @property
    def sitl(self) -> Sitl:
        """Its simulator."""
        return SITLS[self.name]


ARDUPILOT = Real("ardupilot", 4, 17, (1, 17), MODE_LAND_ARDUPILOT, 5.0, leaves_guided=False)  # BRAKE
PX4 = Real(
    "px4", 0x0006_0000, 0x0304_0000, (1, 4, 3), MODE_LAND_PX4, 16.5, leaves_guided=True
)  # LOITER: also the service's own hold
ardupilot = pytest.param(ARDUPILOT, marks=pytest.mark.sitl_ardupilot, id="ardupilot")
px4 = pytest.param(PX4, marks=pytest.mark.sitl_px4, id="px4")
on_ardupilot = pytest.mark.parametrize("real", [ardupilot], indirect=True)
on_both = pytest.mark.parametrize("real", [ardupilot, px4], indirect=True)
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture
def real(request: pytest.FixtureRequest) -> Real:
    try:
        request.param.sitl.find()
    except SimulationError as error:
        pytest.skip(str(error))
    return request.param


def command(*words: str | Path, timeout_s: float = 240.0) -> str:
    """Run a command of ours, which has to succeed without a complaint; return what it said."""
    ran = subprocess.run(
        [sys.executable, "-m", "gcs.cli", *map(str, words)],
        capture_output=True, text=True, timeout=timeout_s, check=False, cwd=ROOT,
    )  # fmt: skip
    print(ran.stdout)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert ran.stderr == ""
    return ran.stdout


def fly(playbook: Path, tmp_path: Path, *options: str, timeout_s: float = 240.0) -> dict[str, Any]:
    """Fly a playbook and return its report."""
    path = tmp_path / "report.json"
    written = ("--seed", "1", "--json", path, "--runs-dir", tmp_path / "runs")
    command("fly", playbook, *options, *written, timeout_s=timeout_s)
    return json.loads(path.read_text())


def require_formed(report: dict[str, Any], receivers: int) -> None:
    """Fail unless everybody stands within a metre of its slot and nobody came too near."""
    errors_m = {receiver["name"]: receiver["placement_error_m"] for receiver in report["receivers"]}
    print(f"placement errors, m: {errors_m}; closest approach {report['min_separation_m']:.1f} m")
    assert report["outcome"] == "formed"
    assert len(errors_m) == receivers
    assert max(errors_m.values()) < 1.0
    assert report["min_separation_m"] > 5.0


@on_both
def test_a_two_leg_route_forms_on_three_vehicles(real: Real, tmp_path: Path) -> None:
    playbook = tmp_path / "three.yaml"
    playbook.write_text(PLAYBOOK)
    report = fly(playbook, tmp_path, "--sitl", real.name)
    require_formed(report, 1)
    assert len(report["receivers"][0]["legs"]) == 2
    assert report["flown_total_length_m"] == pytest.approx(report["planned_total_length_m"], rel=0.1)


@on_both
def test_four_uavs_are_put_up_flown_and_taken_down(real: Real, tmp_path: Path) -> None:
    folder = tmp_path / "swarm"
    command("sitl", "up", CONFIGS / "four.yaml", "--autopilot", real.name, "--folder", folder)
    try:
        require_formed(fly(folder / "playbook.yaml", tmp_path), 4)
    finally:
        said = command("sitl", "down", "--folder", folder)
    assert "ended L0, L1, U1, U2, U3, U4" in said


def test_the_four_form_on_embedded_copters_as_well(tmp_path: Path) -> None:
    require_formed(fly(CONFIGS / "four.yaml", tmp_path, "--speedup", "5"), 4)


@on_ardupilot
def test_the_paper_s_eight_fly_as_far_as_the_embedded_copters_do(real: Real, tmp_path: Path) -> None:
    playbook = CONFIGS / "paper_8.yaml"
    embedded = fly(playbook, tmp_path, "--sigma-deg", "0.1", "--speedup", "5")
    report = fly(playbook, tmp_path, "--sigma-deg", "0.1", "--sitl", real.name, timeout_s=290)
    require_formed(embedded, 8)
    require_formed(report, 8)
    flown_m, expected_m = report["flown_total_length_m"], embedded["flown_total_length_m"]
    print(f"flown {flown_m:.1f} m; embedded {expected_m:.1f} m")
    assert flown_m == pytest.approx(expected_m, rel=0.1)


@pytest.mark.timeout(600)
@on_ardupilot
def test_twenty_uavs_form_in_real_time(real: Real, tmp_path: Path) -> None:
    report = fly(CONFIGS / "waves_20.yaml", tmp_path, "--sitl", real.name, timeout_s=580)
    require_formed(report, 20)
    print(f"{report['duration_s']:.0f} s, flown {report['flown_total_length_m']:.1f} m")


@on_both
async def test_a_pilot_s_mode_mid_leg_ends_the_setpoints_for_good(real: Real, tmp_path: Path) -> None:
    async with open_field(tmp_path, real.sitl) as field:
        await until_fast(field)
        field.wire.command(*real.pilots_parameters)
        asked_s = time.monotonic()
        assert await field.ended(30.0) == 1
        await asyncio.sleep(2.0)
        taken_s = next(at for at, mode in field.wire.modes if at > asked_s and mode == real.pilots_mode)
        before = [at for at in field.wire.setpoints if at <= taken_s + LETS_GO_S]
        after = [at for at in field.wire.setpoints if at > taken_s + LETS_GO_S]
        print(
            f"{real.name}: mode shown {taken_s - asked_s:.2f} s after it was asked for; setpoints before {len(before)},"
            f" after {len(after)}; the last left {before[-1] - taken_s:+.3f} s from that heartbeat"
        )
        assert len(before) > 10
        assert after == []
        assert {mode for at, mode in field.wire.modes if at >= taken_s} == {real.pilots_mode}
        assert field.report()["receivers"][0]["state"] == "PILOT"
        assert "its mode was changed by the pilot" in field.said()


@on_both
async def test_a_service_killed_mid_leg_leaves_vehicles_that_stop_by_themselves_and_then_land(
    real: Real, tmp_path: Path
) -> None:
    async with open_field(tmp_path, real.sitl) as field:
        await until_fast(field)
        field.service.kill()
        await field.service.wait()
        killed_s, place, speed_mps = time.monotonic(), *field.wire.kinematics[-1][1:]
        await asyncio.sleep(3.9)  # less than what either autopilot needs to miss the station's heartbeat
        site, mode = SiteFrame(place), field.wire.modes[-1][1]
        flown = [(at - killed_s, site.from_geodetic(there)[0]) for at, there, _ in field.wire.kinematics]
        stands = flown[-1][1]
        stood_s = max(after_s for after_s, there in flown if abs(there - stands) > 1.0)
        sent = [at for at in field.wire.setpoints if at > killed_s]
        print(
            f"{real.name}: killed at {speed_mps:.2f} m/s; {len(sent)} setpoints after; stands {abs(stands):.1f} m on, "
            f"within 1 m of there {stood_s:.1f} s after; mode {mode:#x}"
        )
        assert sent == []
        assert stood_s < 3.0
        assert abs(stands) < 14.0
        assert mode in (real.guided, PX4.pilots_mode)
        await asyncio.sleep(real.misses_station_s - 1.0)
        for name, wire in field.wires.items():
            missed_s = next(
                (at - killed_s for at, mode in wire.modes if at > killed_s and mode == real.lands), math.inf
            )
            print(f"{name} lands {missed_s:.1f} s after")
            assert missed_s == pytest.approx(real.misses_station_s, abs=2.0)


@on_both
async def test_a_wrong_system_id_is_named_and_nobody_is_armed(real: Real, tmp_path: Path) -> None:
    def changed(playbook: str) -> str:
        return playbook.replace("system_id: 3", "system_id: 33")

    async with open_field(tmp_path, real.sitl, change=changed) as field:
        status, said = await field.ended(90.0), field.said()
        print(said)
        assert status == 1
        assert f"U1 on udpin:127.0.0.1:{field.wire.service[1]}" in said
        assert "no heartbeat of system id 33" in said
        assert "but of 3" in said
        assert "Check the link's address and system id" in said
        assert field.report()["outcome"] == "failed"
        for wire in field.wires.values():
            assert wire.modes, "it was never heard"
            assert wire.was_armed is False
            assert wire.setpoints == []


@on_ardupilot
@pytest.mark.parametrize("name", ["U1", "L1"])
async def test_after_a_reboot_mid_leg_all_hold_and_the_rebooted_one_gets_no_setpoint(
    real: Real, tmp_path: Path, name: str
) -> None:
    async with open_field(tmp_path, real.sitl) as field:
        await until_fast(field)
        wire = field.wires[name]
        wire.command(1, 0, 0, 0, 0, FORCED, number=mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN)
        told_s = time.monotonic()
        assert await field.ended(40.0) == 1
        said = field.said()
        print(said)
        rebooted_s = next(at for at, mode in wire.modes if at > told_s and mode != real.guided)
        held_s = rebooted_s + 1.0
        assert f"{name} has rebooted" in said
        assert [at for at in wire.setpoints if at > rebooted_s + LETS_GO_S] == []
        for other in field.wires.keys() - {name}:
            assert field.wires[other].modes[-1][1] == real.guided
            assert max((speed for at, speed in field.wires[other].velocities if at > held_s), default=0.0) == 0.0
        assert field.report()["receivers"][0]["state"] in ("HELD", "PILOT")


async def until_fast(field: Field) -> None:
    """Return when the receiver flies its second leg at speed."""

    def fast() -> bool:
        return "U1 LEG_2" in field.said() and field.wire.kinematics[-1][2] > 3.5

    await field.until(fast, 150.0)
