"""The main job, end to end, by the commands of the README: real MAVLink, a real bus, embedded copters."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.alone]

ROOT = Path(__file__).parents[2]


def test_the_paper_s_relay_forms(tmp_path: Path) -> None:
    uavs, planned_m = 8, 491.59  # the twenty are in the library of playbooks
    report_path = tmp_path / "report.json"
    options = ["--uavs", str(uavs), "--sigma-deg", "0.1", "--seed", "1", "--speedup", "10"]
    flown = subprocess.run(
        [sys.executable, "-m", "gcs.cli", "demo", *options, "--json", str(report_path), "--runs-dir", str(tmp_path)],
        capture_output=True, text=True, timeout=120, check=False, cwd=ROOT,
    )  # fmt: skip
    assert flown.returncode == 0, flown.stdout + flown.stderr
    assert flown.stderr == ""
    report = json.loads(report_path.read_text())
    assert report["outcome"] == "formed"
    assert report["planned_total_length_m"] == pytest.approx(planned_m, abs=0.01)
    assert report["flown_total_length_m"] == pytest.approx(planned_m, rel=0.03)
    assert len(report["receivers"]) == uavs
    assert {receiver["state"] for receiver in report["receivers"]} == {"PLACED"}
    assert max(receiver["placement_error_m"] for receiver in report["receivers"]) < 1.0
    assert report["min_separation_m"] > 5.0
    reports = report["bearing_reports"]
    assert reports["malformed"] == reports["unknown_sender"] == 0
    folder = next(path for path in tmp_path.iterdir() if path.is_dir())
    assert {"playbook.json", "plan.json", "journal.jsonl", "report.json", "figure.svg"} <= {
        p.name for p in folder.iterdir()
    }
    assert json.loads((folder / "report.json").read_text()) == report
    journal = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    placed = [entry["receiver"] for entry in journal if entry["state"] == "PLACED"]
    assert sorted(placed) == sorted(receiver["name"] for receiver in report["receivers"])


def test_waves_of_the_joint_planner_form(tmp_path: Path) -> None:
    playbook = "sitl_configs/waves_8.yaml"
    report_path = tmp_path / "report.json"
    options = ["--seed", "1", "--speedup", "8", "--json", str(report_path), "--runs-dir", str(tmp_path)]
    flown = subprocess.run(
        [sys.executable, "-m", "gcs.cli", "fly", playbook, *options],
        capture_output=True, text=True, timeout=120, check=False, cwd=ROOT,
    )  # fmt: skip
    assert flown.returncode == 0, flown.stdout + flown.stderr
    report = json.loads(report_path.read_text())
    assert {receiver["state"] for receiver in report["receivers"]} == {"PLACED"}
    assert report["planned_total_length_m"] <= 1.09 * report["straight_line_bound_m"]
    assert max(receiver["placement_error_m"] for receiver in report["receivers"]) < 1.0
    assert report["min_separation_m"] > 5.0
