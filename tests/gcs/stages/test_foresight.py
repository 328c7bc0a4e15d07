"""The dry run: stage by stage what would be done, from the plan alone."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from gcs.commands.fly import fly
from gcs.errors import ServiceError
from gcs.playbook.loader import load_playbook
from gcs.stages.foresight import foresee
from tests.gcs.stages.bench import HEAD

STAGES = """\
stages:
  - connect
  - preflight: {retries: 2}
  - prompt: {text: ready?}
  - arm
  - takeoff: {timeout_s: 60, on_failure: land}
  - locate
  - plan
  - emission: {on: [L1]}
  - inject: {fault: freeze, vehicle: U2, at: {receiver: U1, state: LEG_2, after_s: 2}, for_s: 5}
  - relay: {expect: {placement_error_m: '< 1'}}
  - hold: {for_s: 20}
  - measure
  - emission: {off: [L1]}
  - wait: {for_s: 5}
  - return
expect: {outcome: formed}
"""
app = typer.Typer()
app.command()(fly)


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "foreseen.yaml"
    path.write_text(HEAD + text)
    return path


def test_every_stage_is_foreseen_and_nothing_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, STAGES)
    told = CliRunner().invoke(app, [str(path), "--dry-run"])
    assert told.exit_code == 0, told.output
    lines = told.output.splitlines()
    assert lines[0] == "dry run: bench"
    begins = ["connect: ", "preflight: ", "prompt: the operator is asked: ready? (as asked, ", "arm: armed one after"]
    for number, words in enumerate(begins, start=1):
        assert lines[number].startswith(f"{number:3}  {words}")
    assert "tried 3 times" in lines[2]
    assert "at most 60 s, if it fails: land" in lines[5]
    assert "freeze U2 2 s after U1 is LEG_2, for 5 s" in told.output
    assert "expected: placement_error_m < 1" in told.output
    assert "at the end expected: outcome == formed" in told.output
    assert lines[-1].endswith("transmitter-seconds on embedded; nothing was opened, nothing flew")
    assert list(tmp_path.iterdir()) == [path]


def test_the_relay_is_foreseen_as_planned(tmp_path: Path) -> None:
    playbook = load_playbook(written(tmp_path, STAGES))
    plan = playbook.plan()
    foresight = foresee(playbook, plan)
    by_name = {stage.name: seen for stage, seen in foresight.stages}
    relay = by_name["relay"]
    assert relay.duration_s is not None
    assert relay.duration_s > plan.makespan_s
    for route in plan.routes:
        (line,) = [part for part in relay.parts if part.strip().startswith(f"{route.receiver} to {route.slot}:")]
        assert f"3 sigma {route.predicted_3sigma_m:.2f} m" in line
        assert all(f"{leg.length_m:.1f} m {leg.direction} {leg.guide}" in line for leg in route.legs)
    assert foresight.length_m == plan.total_length_m
    assert foresight.duration_s == pytest.approx(sum(seen.duration_s or 0.0 for seen in by_name.values()))
    hovering_s = 20.0 + 10.0  # the hold and the measurement, with L1 kept on
    emission_s = plan.emission_transmitter_s + hovering_s
    assert emission_s < foresight.emission_transmitter_s < emission_s + 60.0


def test_without_an_emission_stage_nobody_is_on_the_air_but_for_the_relay(tmp_path: Path) -> None:
    playbook = load_playbook(written(tmp_path, "stages: [preflight, takeoff, {hold: {for_s: 100}}, land]\n"))
    foresight = foresee(playbook, playbook.plan())
    assert (foresight.emission_transmitter_s, foresight.length_m) == (0.0, 0.0)
    assert foresight.duration_s > 100.0


def test_every_run_of_a_matrix_is_foreseen_on_its_target(tmp_path: Path) -> None:
    path = written(tmp_path, "matrix: {flight.speed_mps: [2, 4]}\n")
    told = CliRunner().invoke(app, [str(path), "--dry-run", "--target", "ardupilot"])
    assert [line for line in told.output.splitlines() if line.startswith("dry run")] == [
        "dry run: bench flight.speed_mps=2", "dry run: bench flight.speed_mps=4",
    ]  # fmt: skip
    assert told.output.count("on ardupilot; nothing was opened") == 2


def test_two_words_for_a_target_and_a_target_without_vehicles_are_refused(tmp_path: Path) -> None:
    path = str(written(tmp_path, ""))
    twice = CliRunner().invoke(app, [path, "--target", "px4", "--sitl", "px4"])
    assert isinstance(twice.exception, ServiceError)
    assert "the old word" in str(twice.exception)
    nobody = CliRunner().invoke(app, [path, "--target", "vehicles"])
    assert "there are no vehicles" in str(nobody.exception)
