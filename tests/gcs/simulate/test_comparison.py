"""The relay and the paper's beside each other: the same seeds, every number of both, on a page that needs nothing."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest
import typer
from typer.testing import CliRunner

from gcs.commands.simulate import simulate
from gcs.errors import ServiceError
from gcs.simulate.comparison import Arm, arms_of, comparison
from gcs.simulate.comparison_page import comparison_page
from gcs.simulate.outcome import RunResult
from tests.gcs.reports.test_page import Page, require_harmless
from tests.gcs.simulate.small import small, small_text
from tests.gcs.simulate.test_study import a_run


@pytest.fixture
def arms(tmp_path: Path) -> list[Arm]:
    return arms_of(small(tmp_path))


def page_of(arms: list[Arm], results: dict[str, list[RunResult]], folder: Path) -> Page:
    (folder / "page.html").write_text(comparison_page(arms, results), encoding="utf-8")
    page = Page(folder / "page.html")
    require_harmless(page)
    return page


def test_the_paper_is_flown_by_its_chain_as_fast_and_slowly(arms: list[Arm], tmp_path: Path) -> None:
    flown = [(arm.study.plan.method, arm.study.stop, arm.study.playbook.flight.speed_mps) for arm in arms]
    assert flown == [("joint", "filtered", 4.0), ("paper", "raw", 4.0), ("paper", "raw", 1.0)]
    slow = small(tmp_path).model_copy(update={"flight": small(tmp_path).flight.model_copy(update={"speed_mps": 0.8})})
    assert [arm.name for arm in arms_of(slow)] == ["relay", "paper"]


def test_it_counts_who_formed_and_who_stands_within_the_tolerance(arms: list[Arm]) -> None:
    results = {
        "relay": [a_run(1, 0.1), a_run(2, 0.2)],
        "paper": [a_run(1, 6.0), a_run(2, 2.0), a_run(3, None)],
        "paper-slow": [],
    }
    told = comparison(arms, results)
    assert [(of_arm["formed"], of_arm["within_tolerance"]) for of_arm in told.values()] == [(2, 2), (2, 1), (0, 0)]
    assert told["paper"]["of_formed"]["duration_s"]["max"] == 32.0
    assert told["paper"]["duration_s"]["max"] == 33.0
    assert told["paper-slow"]["placement_error_m"]["p50"] is None


def test_the_page_has_both_and_says_what_the_paper_does(arms: list[Arm], tmp_path: Path) -> None:
    results = {
        "relay": [a_run(1, 0.123), a_run(2, 0.123)],
        "paper": [a_run(1, 6.5), a_run(3, None)],
        "paper-slow": [],
    }
    page = page_of(arms, results, tmp_path)
    assert "0.12 · 0.12 · 0.12" in page.text
    assert "6.50 · 6.50 · 6.50" in page.text
    assert "1 of 2 (50 %)" in page.text
    assert "silent" in page.text
    assert "Where the stop angle never comes" in page.text
    assert page.count("svg", class_="chart") == 5
    assert sum(tag == "path" for tag, _ in page.elements) == 10


def test_where_nothing_was_flown_there_is_no_chart(arms: list[Arm], tmp_path: Path) -> None:
    page = page_of(arms, {arm.name: [] for arm in arms}, tmp_path)
    assert page.count("svg") == 0


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    folder = tmp_path_factory.mktemp("compared")
    (folder / "small.yaml").write_text(small_text(), encoding="utf-8")
    arguments = [f"{folder / 'small.yaml'}", "--runs", "1", "--jobs", "1", "--studies-dir", f"{folder / 'studies'}"]
    return folder, arguments


def run(*arguments: str) -> str:
    app = typer.Typer()
    app.command()(simulate)
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_the_command_flies_all_and_goes_on_where_it_was_left(compared: tuple[Path, list[str]]) -> None:
    folder, arguments = compared
    assert "comparison.html" in run(*arguments, "--compare")
    (study,) = (folder / "studies").iterdir()
    told = json.loads((study / "comparison.json").read_bytes())
    assert {name: of_arm["formed"] for name, of_arm in told.items()} == {"relay": 1, "paper": 1, "paper-slow": 1}
    errors_m = {name: of_arm["placement_error_m"]["p50"] for name, of_arm in told.items()}
    assert errors_m["relay"] < errors_m["paper-slow"] < errors_m["paper"]
    require_harmless(Page(study / "comparison.html"))
    line = msgspec.json.encode(a_run(0, 77.0)) + b"\n"
    (study / "paper" / "runs.jsonl").write_bytes(line)
    run(*arguments, "--compare", "--resume", f"{study}", "--json", f"{folder / 'told.json'}")
    told = json.loads((folder / "told.json").read_bytes())
    assert told["paper"]["placement_error_m"]["max"] == 77.0


@pytest.mark.parametrize("option", [("--stop", "raw"), ("--csv", "rows.csv"), ("--plots", "plots")])
def test_options_of_one_study_are_refused(compared: tuple[Path, list[str]], option: tuple[str, str]) -> None:
    _, arguments = compared
    with pytest.raises(ServiceError, match="leave out --compare"):
        run(*arguments, "--compare", *option)
    assert not Path(option[1]).exists()
