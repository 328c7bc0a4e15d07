"""Playbooks with stages, flown by the real command on embedded copters: real faults on real processes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

HEAD = """\
playbook: 1
name: staged
formation: {kind: custom, slots: {O1: [70, 60]}}
transmitters: {L0: {at: [0, 0]}, L1: {at: [100, 0], beacon: true}}
receivers: {U1: {start: [20, 30]}}
flight: {altitude_m: 4, speed_mps: 4, give_up_s: 60}
"""
PILOT = """\
stages:
  - connect
  - preflight
  - takeoff: {timeout_s: 60}
  - locate
  - plan
  - inject: {fault: pilot, vehicle: U1, at: {receiver: U1, state: LEG_1, after_s: 1.5}}
  - relay: {timeout_s: 120, on_failure: skip, expect: {outcome: aborted, receivers_pilot: 1}}
  - measure: {for_s: 2}
  - land: {on_failure: skip}
expect: {held_reason: '~ pilot', min_separation_m: '> 20'}
"""
FAULTS = """\
stages:
  - preflight
  - takeoff
  - emission: {on: [L0]}
  - inject: {fault: link_cut, vehicle: U1, at: {receiver: U1, state: LEG_1, after_s: 1}, for_s: 1.5}
  - inject: {fault: router_killed, at: {receiver: U1, state: LEG_1, after_s: 4}, for_s: 2}
  - inject: {fault: sensor_silent, vehicle: U1, at: {receiver: U1, state: LEG_2, after_s: 1}, for_s: 1.5}
  - inject: {fault: freeze, vehicle: U1, at: {receiver: U1, state: LEG_2, after_s: 8}, for_s: 1.5}
  - relay: {timeout_s: 200}
  - return
"""


def flown(tmp_path: Path, text: str, *options: str) -> tuple[int, str]:
    path = tmp_path / "staged.yaml"
    path.write_text(HEAD + text)
    command = [sys.executable, "-m", "gcs.cli", "fly", str(path), "--speedup", "5", *options]
    done = subprocess.run(
        [*command, "--runs-dir", str(tmp_path / "runs")], capture_output=True, text=True, timeout=200, check=False
    )
    assert done.stderr == ""
    return done.returncode, done.stdout


def report_of(tmp_path: Path) -> dict:
    return json.loads(next((tmp_path / "runs").glob("*/report.json")).read_text())


def test_a_pilot_takes_a_copter_in_mid_leg_and_all_that_was_expected_comes_true(tmp_path: Path) -> None:
    status, said = flown(tmp_path, PILOT)
    assert status == 0, said
    report = report_of(tmp_path)
    outcomes = {stage["name"]: stage["outcome"] for stage in report["stages"]}
    assert {name for name, outcome in outcomes.items() if outcome == "failed"} == {"relay", "land"}
    assert set(outcomes.values()) == {"done", "failed"}
    assert [verdict["passed"] for verdict in report["verdicts"]] == [True] * 4
    assert report["outcome"] == "aborted"
    assert report["receivers"][0]["state"] == "PILOT"
    assert report["measurements"][0]["receivers"]["U1"]["max_m"] > 20.0
    assert "injected: pilot U1" in said
    assert "U1 is its pilot's and was not landed" in said
    folder = next((tmp_path / "runs").iterdir())
    journal = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    states = [(line["stage"], line["state"]) for line in journal if "stage" in line]
    assert states[:4] == [("connect", "begun"), ("connect", "done"), ("preflight", "begun"), ("preflight", "done")]
    assert (folder / "report.html").is_file()


def test_what_falls_silent_for_a_moment_is_stopped_and_flown_on_and_all_return(tmp_path: Path) -> None:
    status, said = flown(tmp_path, FAULTS)
    assert status == 0, said
    report = report_of(tmp_path)
    assert report["outcome"] == "formed"
    assert {stage["outcome"] for stage in report["stages"]} == {"done"}
    assert report["receivers"][0]["placement_error_m"] < 1.0  # as it stood, and not at home again
    for fault in ("link_cut U1", "router_killed", "sensor_silent U1", "freeze U1"):
        assert f"injected: {fault}" in said
        assert f"over: {fault}" in said
    assert "the bus router cannot be reached" in said
    assert "no telemetry for" in said
    assert "no bearing report from its sensor" in said
    assert [line.split()[-2] for line in said.splitlines() if line.endswith(" returns")][-1] == "U1"


def test_every_run_of_a_matrix_has_its_own_folder_and_what_is_not_expected_fails(tmp_path: Path) -> None:
    stages = "stages: [connect, preflight]\n"
    reports = tmp_path / "reports.json"
    status, said = flown(tmp_path, stages + "matrix: {seed: [3, 4]}\n", "--json", str(reports))
    assert status == 0, said
    told = json.loads(reports.read_text())
    assert [(report["seed"], report["matrix"], report["outcome"]) for report in told] == [
        (3, {"seed": 3}, "completed"), (4, {"seed": 4}, "completed"),
    ]  # fmt: skip
    assert len(list((tmp_path / "runs").iterdir())) == 2
    status, said = flown(tmp_path, stages + "expect: {receivers_placed: 1}\n", "--seed", "9")
    assert status == 1
    assert "not as expected receivers_placed 0, expected == 1" in said
