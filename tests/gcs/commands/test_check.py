"""The check command: against copters that may fly and one that may not, and what a user may get wrong."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from rich.console import Console

from drivers.errors import SimulationError
from drivers.mavlink.checks import Check, Verdict
from gcs.commands.check import check, check_table
from gcs.commands.options import SitlName, TargetName
from gcs.errors import ServiceError
from gcs.playbook.loader import PlaybookError
from tests.gcs.field import free_udp_port

COMMAND = [sys.executable, "-c", "import typer; from gcs.commands.check import check; typer.run(check)"]
PLAYBOOK = """\
playbook: 1
name: two
formation: {kind: custom, slots: {O1: [70, 60]}}
transmitters:
  L0: {at: [0, 0]}
  L1: {at: [100, 0], beacon: true}
receivers:
  U1: {start: [20, 30]}
"""
VEHICLES = """\
vehicles:
  L0: {{link: 'udpin:127.0.0.1:{l0}', system_id: 1}}
  U1: {{link: 'udpin:127.0.0.1:{u1}', system_id: 2}}
"""
HOMES = {"l0": "-35.363262,149.165237,584,0", "u1": "-35.362991572,149.165457052,584,0"}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "two.yaml"
    path.write_text(PLAYBOOK)
    return path


@pytest.fixture
def one_may_not(path: Path) -> Iterator[Path]:
    """A playbook of two running copters, of which U1's fence is too low."""
    ports = {"l0": free_udp_port(), "u1": free_udp_port()}
    path.write_text(PLAYBOOK + VEHICLES.format(**ports))
    with ExitStack() as stack:
        for system_id, (name, home) in enumerate(HOMES.items(), start=1):
            fence = ["FENCE_ENABLE=1", "FENCE_TYPE=1", "FENCE_ALT_MAX=10"] if name == "u1" else []
            command = [sys.executable, "-m", "drivers.simulation.copter", "--name", name, "--system-id", str(system_id)]
            command += ["--parent-pid", str(os.getpid()), "--link", f"udpout:127.0.0.1:{ports[name]}", f"--home={home}"]
            command += [word for parameter in fence for word in ("--param", parameter)]
            process = stack.enter_context(subprocess.Popen(command))
            stack.callback(process.kill)
        yield path


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.slow
def test_copters_that_may_fly_end_with_0_and_a_table(path: Path) -> None:
    ended = run(str(path))
    assert ended.returncode == 0, ended.stderr
    assert "may arm" in ended.stdout
    assert "ArduPilot 4.6.2" in ended.stdout
    assert "estimator" not in ended.stdout, "what passed is shown on request only"


@pytest.mark.slow
def test_a_hard_failure_ends_with_1_and_the_report_is_json_and_nothing_else(one_may_not: Path) -> None:
    ended = run(str(one_may_not), "--json")
    assert ended.returncode == 1, ended.stderr
    report = json.loads(ended.stdout)
    assert (report["playbook"], report["may_arm"]) == ("two", False)
    hard = [found for found in report["checks"] if found["verdict"] == "hard"]
    assert [(found["vehicle"], found["name"]) for found in hard] == [("U1", "geofence")]
    assert hard[0].keys() == {"vehicle", "link", "name", "verdict", "found", "way_out"}
    assert {found["verdict"] for found in report["checks"]} <= {"passed", "soft", "hard"}


def test_what_is_wrong_in_the_playbook_is_said_before_any_link_is_opened(path: Path) -> None:
    path.write_text(PLAYBOOK.replace("receivers", "recievers"))
    with pytest.raises(PlaybookError, match="recievers"):
        check(path)


def test_a_simulator_is_not_for_vehicles_that_are_there(path: Path) -> None:
    path.write_text(PLAYBOOK + VEHICLES.format(l0=14550, u1=14551))
    with pytest.raises(ServiceError, match="--sitl starts the vehicles itself"):
        check(path, sitl=SitlName["px4"])


def test_a_simulator_nobody_has_is_said(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARDUCOPTER", str(path.parent / "arducopter"))
    with pytest.raises(SimulationError, match="set ARDUCOPTER"):
        check(path, sitl=SitlName["ardupilot"])


def test_what_is_found_of_several_vehicles_is_one_row_and_shown_as_it_was_said(
    capsys: pytest.CaptureFixture[str],
) -> None:
    said = "PreArm: [compass] not healthy"
    checks = [Check(name, "pre-arm", Verdict.HARD, said, "Clear it.") for name in ("U1", "U2")]
    Console(width=120).print(check_table([*checks, Check("U3", "battery", Verdict.SOFT, "30 %", "Charge it.")]))
    lines = [line for line in capsys.readouterr().out.splitlines() if "pre-arm" in line]
    assert len(lines) == 1
    assert "U1, U2" in lines[0]
    assert said in lines[0]


def test_a_target_is_named_once_and_has_to_be_there(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ServiceError, match="the old word"):
        check(path, target=TargetName("px4"), sitl=SitlName("px4"))
    with pytest.raises(ServiceError, match="there are no vehicles"):
        check(path, target=TargetName("vehicles"))
    monkeypatch.setenv("PX4", "/nowhere/px4")
    path.write_text(PLAYBOOK + VEHICLES.format(l0=1, u1=2))
    with pytest.raises(SimulationError, match="no program"):  # its vehicles are left alone
        check(path, target=TargetName("px4"))
