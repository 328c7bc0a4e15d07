"""A campaign flies the faults of every seed, says what it found by fault, and each seed repeats its run."""

from __future__ import annotations

import json
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest
import typer

from gcs.commands.faults import faults
from gcs.errors import ServiceError
from gcs.faults.campaign import fly_campaign, fly_many, summary
from gcs.faults.fault import KINDS, Fault, Moment
from gcs.faults.findings import Finding
from gcs.faults.outcome import FaultRun
from tests.gcs.simulate.small import small, small_text

CUT = Fault("link_cut", "U1", Moment("U1", "LEG_1", 1.0), None)
SILENT = Fault("sensor_silent", "U1", Moment("U1", "LEG_2", 1.0), 2.0)


def a_run(seed: int, *struck_s: float | None, found: tuple[Finding, ...] = ()) -> FaultRun:
    faults_drawn = [CUT, SILENT][: len(struck_s)]
    why = {"attended": False, "outcome": "held", "reason": "why"}
    return FaultRun(
        seed, faults=faults_drawn, struck_s=list(struck_s), duration_s=30.0, closest_m=20.0 - seed, wrong_placements=1,
        doubted_placements=1,
        violations=list(found), **why,
    )  # fmt: skip


def test_what_was_found_is_counted_by_what_struck(tmp_path: Path) -> None:
    finding = Finding("stopped", "U1", 9.0, "it flies on")
    told = summary(small(tmp_path), 1, [a_run(1, 5.0, found=(finding,)), a_run(2, 5.0, None), a_run(3, None)])
    assert (told["runs"], told["struck"], told["outcomes"], told["closest_m"]) == (3, 2, {"held": 3}, 17.0)
    assert (told["wrong_placements"], told["doubted_placements"]) == (3, 3)
    assert told["by_fault"].keys() == set(KINDS)
    assert told["by_fault"]["link_cut"]["runs"] == 2
    assert told["by_fault"]["link_cut"]["violations"] == told["by_invariant"]["stopped"] == 1
    assert told["by_fault"]["sensor_silent"]["runs"] == 0
    (violation,) = told["violations"]
    assert (violation["seed"], violation["invariant"], violation["faults"][0]["kind"]) == (1, "stopped", "link_cut")


def test_the_runs_of_a_campaign_are_those_of_their_seeds(tmp_path: Path) -> None:
    playbook, told = small(tmp_path, two=True), []
    plan = playbook.plan()
    with ThreadPoolExecutor(1) as pool:
        runs = fly_campaign(playbook, plan, range(10, 19), pool, 1, told.append)
    assert [run.seed for run in runs] == list(range(10, 19))
    assert sorted(told, key=lambda run: run.seed) == runs
    assert [run.violations for run in runs] == [[]] * 9
    assert any(at_s is not None for run in runs for at_s in run.struck_s)
    assert fly_many(playbook, plan, [17]) == [runs[7]]


def test_the_command_writes_what_it_found(tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(small_text(), encoding="utf-8")
    faults(path, runs=3, seed=4, jobs=1, json=tmp_path / "found.json")
    told = json.loads((tmp_path / "found.json").read_text())
    assert (told["runs"], told["first_seed"], told["violations"]) == (3, 4, [])
    assert sum(of_kind["runs"] for of_kind in told["by_fault"].values()) >= told["struck"] > 0


def test_violations_are_said_and_fail_the_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(small_text(), encoding="utf-8")
    bad = a_run(4, 5.0, found=(Finding("stopped", "U1", 9.0, "it flies on"),))
    monkeypatch.setattr("gcs.commands.faults.fly_campaign", lambda *_: [bad])
    with pytest.raises(typer.Exit) as exit_:
        faults(path, runs=1, seed=4, jobs=1, json=None)
    assert exit_.value.exit_code == 1
    assert "stopped: seed 4, 9.0 s: U1: it flies on" in capsys.readouterr().out


def test_a_report_that_cannot_be_written_is_said_before_anything_is_flown(tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(small_text(), encoding="utf-8")
    with pytest.raises(ServiceError, match="cannot be written"):
        faults(path, runs=1, seed=1, jobs=1, json=tmp_path / "nowhere" / "found.json")


def test_a_process_that_dies_is_an_error_that_names_the_seeds(tmp_path: Path) -> None:
    playbook = small(tmp_path)
    dying: Future[list[FaultRun]] = Future()
    dying.set_exception(BrokenProcessPool())
    with ThreadPoolExecutor(1) as pool:
        pool.submit = lambda *_: dying
        with pytest.raises(ServiceError, match="seeds 7, 8"):
            fly_campaign(playbook, playbook.plan(), range(7, 9), pool, 1, lambda _: None)
