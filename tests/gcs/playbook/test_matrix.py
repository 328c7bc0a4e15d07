"""The matrix of a playbook: every combination is a run of its own, checked like a playbook of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.playbook.formation import Line
from gcs.playbook.loader import PlaybookError, load_playbook, load_runs
from gcs.playbook.matrix import MOST_RUNS, MatrixRun
from tests.gcs.playbook.test_loader import GOOD

MATRIX_LINE = GOOD.count("\n") + 1


def runs(tmp_path: Path, matrix: str) -> tuple[MatrixRun, ...]:
    path = tmp_path / "matrix.yaml"
    path.write_text(GOOD + matrix, encoding="utf-8")
    return load_runs(path)


def problems(tmp_path: Path, matrix: str) -> list[str]:
    with pytest.raises(PlaybookError) as caught:
        runs(tmp_path, matrix)
    return [f"{problem.line - MATRIX_LINE}:{problem.column}: {problem.message}" for problem in caught.value.problems]


def test_every_combination_is_a_run(tmp_path: Path) -> None:
    made = runs(tmp_path, "matrix:\n  sensor.sigma_deg: [0.1, 0.5]\n  seed: [1, 2, 3]\n")
    found = [(run.playbook.sensor.sigma_deg, run.playbook.seed) for run in made]
    assert found == [(0.1, 1), (0.1, 2), (0.1, 3), (0.5, 1), (0.5, 2), (0.5, 3)]
    assert made[4].values == {"sensor.sigma_deg": 0.5, "seed": 2}
    assert made[4].label == "sensor.sigma_deg=0.5, seed=2"
    assert all(run.playbook.matrix == {} for run in made)


def test_a_whole_section_may_be_another(tmp_path: Path) -> None:
    line = "{kind: line, slots: 3, spacing_m: 25}"
    made = runs(tmp_path, f"matrix: {{formation: [{{kind: circle, slots: 3, radius_m: 50}}, {line}]}}\n")
    assert isinstance(made[1].playbook.formation, Line)


def test_without_a_matrix_there_is_one_run_that_changes_nothing(tmp_path: Path) -> None:
    (run,) = runs(tmp_path, "")
    assert (run.values, run.label) == ({}, "")
    assert run.playbook == load_playbook(tmp_path / "matrix.yaml")


def test_the_playbook_itself_is_as_written(tmp_path: Path) -> None:
    runs(tmp_path, "sensor: {sigma_deg: 2}\nmatrix: {sensor.sigma_deg: [0.1, 0.5]}\n")
    assert load_playbook(tmp_path / "matrix.yaml").sensor.sigma_deg == 2.0


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        ("matrix: {sensor.sigma_dge: [1]}\n", "0:29: matrix.sensor.sigma_dge.0: sensor.sigma_dge: unknown key; did yo"),
        ("matrix: {sensr.sigma_deg: [1]}\n", "0:28: matrix.sensr.sigma_deg.0: sensr: unknown key; did you mean 'senso"),
        ("matrix: {sensor.sigma_deg: [0.1, 99]}\n", "0:34: matrix.sensor.sigma_deg.1: sensor.sigma_deg: Input should "),
        ("matrix: {seed: [1, x]}\n", "0:20: matrix.seed.1: seed: Input should be a valid integer, found 'x'"),
        ("matrix: {seed: 3}\n", "0:10: matrix.seed: Input should be a valid list"),
        ("matrix: {seed: []}\n", "0:10: matrix.seed: List should have at least 1 item"),
        ("matrix: [seed]\n", "0:1: matrix: Input should be a valid dictionary"),
        ("matrix: {name: [a, b]}\n", "0:10: matrix.name: name is the same in all runs of a playbook"),
        ("matrix: {stages: [[land]]}\n", "0:10: matrix.stages: stages is the same in all runs"),
        ("matrix: {seed.x: [1]}\nseed: 4\n", "0:10: matrix.seed.x: seed is one value and has no parts"),
        ("matrix: {'sensor.': [1]}\n", "0:10: matrix.sensor.: is no path of keys: write it as sensor.sigma_deg"),
        ("matrix: {formation.radius_m: [50, -1]}\n", "0:35: matrix.formation.radius_m.1: formation.radius_m: Input sh"),
        ("matrix: {receivers.U1.start: [[1]]}\n", "0:31: matrix.receivers.U1.start.0: receivers.U1.start: a point is"),
        (f"matrix: {{seed: {list(range(15))}, planner.samples: {list(range(1, 15))}}}\n", "0:1: matrix: makes 210 run"),
    ],
)  # fmt: skip
def test_each_problem_with_its_place(tmp_path: Path, matrix: str, expected: str) -> None:
    assert any(problem.startswith(expected) for problem in problems(tmp_path, matrix)), problems(tmp_path, matrix)


def test_what_only_goes_wrong_together_says_with_what(tmp_path: Path) -> None:
    matrix = "matrix:\n  receivers.U2.start: [[-70, 20], [5, 5]]\n  receivers.U3.start: [[15, -80], [5, 5]]\n"
    (problem,) = problems(tmp_path, matrix)
    assert problem.startswith("0:1: matrix: with {'receivers.U2.start': [5, 5], 'receivers.U3.start': [5, 5]}: ")
    assert "lie at the same place" in problem


def test_what_is_wrong_with_the_playbook_itself_is_said_once(tmp_path: Path) -> None:
    found = problems(tmp_path, "flight: {speed: 3}\nmatrix: {seed: [1, 2, 3]}\n")
    assert len(found) == 1
    assert MOST_RUNS >= 100
