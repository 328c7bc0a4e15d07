"""Real autopilots in their own simulators: a relay forms, a pilot has the last word, a killed service lets go.

Skipped without a program; a skip is not a pass.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.errors import SimulationError
from drivers.simulation.sitl import SITLS, Sitl
from planner.frames import SiteFrame
from tests.gcs.field import Field, open_field

ROOT = Path(__file__).parents[2]
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


@dataclass(frozen=True)
class Real:
    """A real autopilot: its simulator, and the mode a pilot's station asks for."""

    sitl: Sitl
    guided: int
    pilots_mode: int
    pilots_parameters: tuple[float, ...]


AUTOPILOTS = {
    "ardupilot": Real(SITLS["ardupilot"], 4, 17, (1, 17)),  # BRAKE
    "px4": Real(SITLS["px4"], 0x0006_0000, 0x0304_0000, (1, 4, 3)),  # LOITER: also the service's own hold
}
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture(
    params=[
        pytest.param("ardupilot", marks=pytest.mark.sitl_ardupilot),
        pytest.param("px4", marks=pytest.mark.sitl_px4),
    ]
)
def name(request: pytest.FixtureRequest) -> str:
    try:
        SITLS[request.param].find()
    except SimulationError as error:
        pytest.skip(str(error))
    return str(request.param)


def test_a_two_leg_route_forms_on_three_vehicles(name: str, tmp_path: Path) -> None:
    playbook, report_path = tmp_path / "three.yaml", tmp_path / "report.json"
    playbook.write_text(PLAYBOOK)
    options = ["--sitl", name, "--seed", "1", "--json", str(report_path), "--runs-dir", str(tmp_path / "runs")]
    flown = subprocess.run(
        [sys.executable, "-m", "gcs.cli", "fly", str(playbook), *options],
        capture_output=True, text=True, timeout=240, check=False, cwd=ROOT,
    )  # fmt: skip
    print(flown.stdout)
    assert flown.returncode == 0, flown.stdout + flown.stderr
    assert flown.stderr == ""
    report = json.loads(report_path.read_text())
    (receiver,) = report["receivers"]
    assert report["outcome"] == "formed"
    assert len(receiver["legs"]) == 2
    assert receiver["placement_error_m"] < 1.0
    assert report["flown_total_length_m"] == pytest.approx(report["planned_total_length_m"], rel=0.1)
    assert report["min_separation_m"] > 5.0


async def test_a_pilot_s_mode_mid_leg_ends_the_setpoints_for_good(name: str, tmp_path: Path) -> None:
    real = AUTOPILOTS[name]
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
            f"{name}: mode shown {taken_s - asked_s:.2f} s after it was asked for; setpoints before {len(before)}, "
            f"after {len(after)}; the last left {before[-1] - taken_s:+.3f} s from that heartbeat"
        )
        assert len(before) > 10
        assert after == []
        assert {mode for at, mode in field.wire.modes if at >= taken_s} == {real.pilots_mode}
        assert field.report()["receivers"][0]["state"] == "PILOT"
        assert "its mode was changed by the pilot" in field.said()


async def test_a_service_killed_mid_leg_leaves_a_vehicle_that_stops_by_itself(name: str, tmp_path: Path) -> None:
    real = AUTOPILOTS[name]
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
            f"{name}: killed at {speed_mps:.2f} m/s; {len(sent)} setpoints after; stands {abs(stands):.1f} m on, "
            f"within 1 m of there {stood_s:.1f} s after; mode {mode:#x}"
        )
        assert sent == []
        assert stood_s < 3.0
        assert abs(stands) < 14.0
        assert mode in (real.guided, 0x0304_0000)


async def until_fast(field: Field) -> None:
    """Return when the receiver flies its second leg at speed."""

    def fast() -> bool:
        return "U1 LEG_2" in field.said() and field.wire.kinematics[-1][2] > 3.5

    await field.until(fast, 150.0)
