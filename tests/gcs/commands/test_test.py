"""`test` without a flight: what it finds, what it leaves out, and what it says of what cannot be flown."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest
import typer
from typer.testing import CliRunner

from gcs.commands.test import run_tests
from gcs.errors import ServiceError
from gcs.service import Show
from gcs.trials import find_playbooks, fly_trial, trials
from tests.gcs.expectations.damages import damages

GOOD = """\
playbook: 1
name: three
formation: {kind: circle, slots: 3, radius_m: 60}
transmitters: {L0: {at: [0, 0]}, L1: {at: [60, 0]}}
receivers: {U1: {start: [20, 40]}, U2: {start: [-70, 20]}, U3: {start: [15, -80]}}
"""
REAL = GOOD + "fleet: {link: 'udpin:127.0.0.1:14550'}\nvehicles:\n" + "".join(
    f"  {name}: {{system_id: {number}}}\n" for number, name in enumerate(["L0", "L1", "U1", "U2", "U3"], start=1)
)  # fmt: skip
SWEEP = GOOD + "slow: true\nmatrix: {sensor.sigma_deg: [0.1, 0.5], seed: [1, 2]}\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    playbooks = tmp_path / "playbooks"
    (playbooks / "deeper").mkdir(parents=True)
    (playbooks / "b_real.yaml").write_text(REAL)
    (playbooks / "deeper" / "sweep.yml").write_text(SWEEP)
    (playbooks / "notes.txt").write_text("not a playbook")
    return playbooks


def run(*arguments: object) -> tuple[int, str]:
    app = typer.Typer()
    app.command()(run_tests)
    ran = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert ran.exception is None or isinstance(ran.exception, SystemExit), ran.exception
    return ran.exit_code, ran.output


def nobody_looks() -> Show:
    raise AssertionError("nothing is flown here")


def test_playbooks_are_found_in_folders_and_theirs_and_once(folder: Path) -> None:
    sweep = folder / "deeper" / "sweep.yml"
    assert find_playbooks([folder, sweep]) == [folder / "b_real.yaml", sweep]
    (folder / "empty").mkdir()
    with pytest.raises(ServiceError, match="empty holds no playbook: they end in"):
        find_playbooks([folder, folder / "empty"])


def test_a_file_that_is_not_there_is_an_error_beside_the_others(folder: Path) -> None:
    missing, other = trials([folder / "none.yaml", folder / "b_real.yaml"], "embedded", slow=False)
    assert "none.yaml:1:1: cannot be read" in missing.problem
    assert other.problem == ""


def test_every_run_of_a_matrix_is_one_trial_and_slow_ones_are_asked_for(folder: Path) -> None:
    found = trials([folder / "deeper"], None, slow=False)
    assert [trial.name for trial in found] == [
        f"three sensor.sigma_deg={sigma_deg}, seed={seed}" for sigma_deg in (0.1, 0.5) for seed in (1, 2)
    ]
    assert {trial.skipped for trial in found} == {"it is slow: only with --slow"}
    wanted = trials([folder / "deeper"], None, slow=True, only="SIGMA_DEG=0.5")
    assert [(trial.run.playbook.sensor.sigma_deg, trial.run.playbook.seed) for trial in wanted] == [(0.5, 1), (0.5, 2)]
    assert {trial.skipped for trial in wanted} == {""}


def test_real_vehicles_fly_only_when_the_command_says_so(folder: Path) -> None:
    [unasked] = trials([folder / "b_real.yaml"], None, slow=False)
    assert unasked.skipped.startswith("it flies real vehicles: only with --target vehicles")
    [asked] = trials([folder / "b_real.yaml"], "vehicles", slow=False)
    [simulated] = trials([folder / "b_real.yaml"], "embedded", slow=False)
    assert asked.skipped == simulated.skipped == ""
    assert asked.run.playbook.vehicles is not None
    assert simulated.run.playbook.vehicles is None


def test_a_playbook_that_names_no_vehicles_cannot_fly_on_them(folder: Path) -> None:
    [trial] = trials([folder / "deeper"], "vehicles", slow=True, only="sweep.yml")
    assert "cannot be flown on vehicles" in trial.problem


def test_a_name_that_no_run_has(folder: Path) -> None:
    with pytest.raises(ServiceError, match=r"no run is called anything like 'nine'.*three"):
        trials([folder], None, slow=False, only="nine")


def test_nothing_flown_is_no_success(folder: Path, tmp_path: Path) -> None:
    status, said = run(folder, "--junit", tmp_path / "junit.xml")
    assert status == 2
    assert "5 skipped" in said
    suites = list(ElementTree.parse(tmp_path / "junit.xml").getroot())
    assert [suite.attrib["skipped"] for suite in suites] == ["1"] * 5


def test_where_junit_cannot_be_written_is_said_before_anything_flies(folder: Path) -> None:
    app = typer.Typer()
    app.command()(run_tests)
    ran = CliRunner().invoke(app, [str(folder), "--junit", str(folder / "none" / "junit.xml")])
    assert isinstance(ran.exception, ServiceError)
    assert ran.output == ""


def test_two_hundred_spoilt_playbooks_are_two_hundred_errors_at_their_places(tmp_path: Path) -> None:
    spoilt = {tmp_path / "spoilt" / f"{number:03}.yaml": damage for number, damage in enumerate(damages(7, 200))}
    (tmp_path / "spoilt").mkdir()
    for path, damage in spoilt.items():
        path.write_text(damage.text, encoding="utf-8")
    status, said = run(tmp_path / "spoilt", "--junit", tmp_path / "junit.xml", "--runs-dir", tmp_path / "runs")
    assert status == 2
    assert "200 error" in said
    assert "Traceback" not in said
    assert all(f"{path}:" in said for path in spoilt)
    suites = list(ElementTree.parse(tmp_path / "junit.xml").getroot())
    assert [suite.attrib["errors"] for suite in suites] == ["1"] * 200
    assert not (tmp_path / "runs").exists()


def test_a_run_without_a_plan_is_an_error_in_words(tmp_path: Path) -> None:
    (tmp_path / "short.yaml").write_text(GOOD + "planner: {method: joint, max_leg_m: 1}\n")
    [trial] = trials([tmp_path], None, slow=False)
    suite = fly_trial(trial, tmp_path / "runs", 1.0, nobody_looks)
    assert suite.error
    assert not (tmp_path / "runs").exists()
