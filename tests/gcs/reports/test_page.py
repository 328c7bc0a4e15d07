"""report.html: complete, self-contained and harmless, whatever a run left behind and whatever things are called."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from gcs.commands.report import report
from gcs.errors import ServiceError
from gcs.reports.comparison import write_comparison
from gcs.reports.page import write_report
from gcs.reports.run_data import load_run, state_intervals
from tests.gcs.relay.world import World
from tests.gcs.reports.virtual_run import fly

VOID = {"br", "hr", "meta"}
HOSTILE = """--></style><script>alert(1)</script><img src=x onerror='a("&amp;")'>"""


class Page(HTMLParser):
    """A page taken apart: its elements, its text, and whether what is opened is closed."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data

    def count(self, tag: str, **attributes: str) -> int:
        return sum(
            name == tag and all(found.get(key.rstrip("_")) == value for key, value in attributes.items())
            for name, found in self.elements
        )


def require_harmless(page: Page) -> None:
    """Check that a page loads nothing and runs nothing."""
    assert not {"script", "link", "img", "iframe", "object", "embed", "base", "form"} & {
        tag for tag, _ in page.elements
    }
    for _, attributes in page.elements:
        assert not any(key.startswith("on") for key in attributes)
        for key in ("src", "href", "xlink:href", "srcset", "action"):
            assert (attributes.get(key) or "#").startswith("#")
        for value in attributes.values():
            assert all(target.startswith("#") for target in re.findall(r"url\(\s*['\"]?([^)]*)", value or ""))


def silence(world: World, time_s: float) -> None:
    if time_s > 70.0:
        world.silenced.add("U3")


@pytest.fixture(scope="module")
def formed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fly(tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module")
def aborted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fly(tmp_path_factory.mktemp("runs"), silence)


@pytest.fixture
def copied(formed: Path, tmp_path: Path) -> Path:
    """A formed run's folder that a test may spoil."""
    return Path(shutil.copytree(formed, tmp_path / "run"))


def change(path: Path, **values: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


def test_a_formed_run_is_on_one_page_with_everything_recorded(formed: Path) -> None:
    path = write_report(formed)
    page = Page(path)
    require_harmless(page)
    assert path == formed / "report.html"
    assert path.stat().st_size < 2_000_000
    assert page.count("span", class_="verdict formed") == 1
    assert page.count("span", class_="state placed") == 8 + 8  # the receivers, and the events
    assert page.count("svg", class_="chart") == 2 * 16 + 3  # two of each leg; distance, estimate, separation
    assert page.count("i", class_="leg-1") == 8 + 1  # a bar each, and the legend
    data = load_run(formed)
    assert data.result is not None
    on_air_s = sum(end - start for intervals in data.emission.values() for start, end in intervals)
    assert on_air_s == pytest.approx(data.result.emission_transmitter_s, rel=0.01)
    assert f"{on_air_s:.0f} s" in page.text
    for part in ("flight.mcap", "numpy", "min_separation_m", "bearings put it", "L0→L1", "uav/U1/bearings"):
        assert part in page.text


def test_states_follow_one_another_without_a_gap(formed: Path) -> None:
    data = load_run(formed)
    for name in data.receivers:
        intervals = list(state_intervals(data, name))
        assert [state for state, _, _ in intervals][-3:] == ["LEG_2", "VERIFYING", "PLACED"]
        assert intervals[0][1] == 0.0
        assert intervals[-1][2] == data.end_s
        assert all(end == start for (_, _, end), (_, start, _) in pairwise(intervals))


def test_legs_end_at_their_stop_angle(formed: Path) -> None:
    data = load_run(formed)
    assert len(data.legs) == 16
    for leg in data.legs:
        assert leg.end_s is not None
        assert leg.samples[-1][0] <= leg.end_s + 0.01
        assert leg.samples[-1][1].angle_rad == pytest.approx(leg.begun.stop_angle_rad, abs=0.05)


def test_an_aborted_run_says_who_is_held_and_why(aborted: Path) -> None:
    page = Page(write_report(aborted))
    assert page.count("span", class_="verdict aborted") == 1
    assert page.count("ul", class_="complaints") == 1
    assert "U3 HELD: no bearing report from its sensor" in page.text
    assert "did not reach its stop condition" in page.text


@pytest.mark.parametrize(
    ("file", "where"),
    [
        ("run.json", ["versions", "numpy"]),
        ("report.json", ["receivers", 0, "reason"]),
        ("report.json", ["receivers", 0, "state"]),
        ("plan.json", ["method"]),
        ("plan.json", ["receivers", 0, "slot"]),
        ("plan.json", ["receivers", 7, "name"]),
        ("playbook.json", ["name"]),
        ("traffic.json", ["stopped"]),
    ],
)
def test_what_things_are_called_is_never_markup(copied: Path, file: str, where: list[Any]) -> None:
    data = at = json.loads((copied / file).read_text())
    for key in where[:-1]:
        at = at[key]
    at[where[-1]] = HOSTILE
    (copied / file).write_text(json.dumps(data))
    with (copied / "journal.jsonl").open("a") as journal:
        entry = {"time_ns": 1_800_000_100_000_000_000, "receiver": HOSTILE, "state": HOSTILE, "reason": HOSTILE}
        journal.write(json.dumps({**entry, HOSTILE: HOSTILE}) + "\n")
    page = Page(write_report(copied))
    require_harmless(page)
    assert HOSTILE in page.text


def test_a_service_that_was_killed_leaves_a_report_of_what_it_had_recorded(copied: Path) -> None:
    for name in ("report.json", "traffic.json"):
        (copied / name).unlink()
    for name in ("journal.jsonl", "series.jsonl"):
        whole = (copied / name).read_bytes()
        (copied / name).write_bytes(whole[: len(whole) // 2])
    page = Page(write_report(copied))
    assert page.count("span", class_="verdict unfinished") == 1
    assert "the service ended before its report" in page.text
    assert "not in the folder: traffic.json" in page.text
    assert 4 <= page.count("svg", class_="chart") < 2 * 16 + 3


def test_a_run_that_recorded_nothing_but_its_plan(copied: Path) -> None:
    for path in copied.iterdir():
        if path.is_file() and path.name not in ("plan.json", "playbook.json"):
            path.unlink()
    page = Page(write_report(copied))
    assert page.count("svg", class_="chart") == 0
    assert "not recorded" in page.text


def test_times_out_of_this_world_do_no_harm(copied: Path) -> None:
    with (copied / "journal.jsonl").open("a") as journal:
        journal.writelines(f'{{"time_ns": {time_ns}, "relay": "late"}}\n' for time_ns in (10**30, -1, 1e300, '"now"'))
    page = Page(write_report(copied))
    assert page.text.count("relay: late") == 4


def test_what_the_bus_refused_is_a_complaint(copied: Path) -> None:
    change(copied / "report.json", refused_on_bus={"strangers": 2, "speaking": {"uav.<b>": 1}})
    page = Page(write_report(copied))
    require_harmless(page)
    assert "3 refused on the bus: 2 strangers, 1 speaking for others (uav.<b> 1)" in page.text


def test_links_are_shown_when_they_were_noted(copied: Path) -> None:
    links = [{"vehicles": "U1", "address": "udpin:<b>", "lost_share": 0.125, "heard": [1, 2], "silent_for_s": None}]
    change(copied / "report.json", links=links)
    page = Page(write_report(copied))
    require_harmless(page)
    for text in ("lost share", "0.125", "udpin:<b>", "1, 2"):
        assert text in page.text


@pytest.mark.parametrize(
    ("file", "content", "expected"),
    [
        ("plan.json", "{}", "is not a plan"),
        ("plan.json", '{"receivers": 3}', "is not a plan"),
        ("plan.json", "{", "is not a plan"),
        ("playbook.json", "{}", "is not what a run leaves behind"),
        ("report.json", "[]", "is not what a run leaves behind"),
        ("report.json", '{"outcome": 3}', "is not what a run leaves behind"),
        ("traffic.json", "nothing", "is not what a run leaves behind"),
        ("run.json", '{"started_ns": "now"}', "is not what a run leaves behind"),
        ("run.json", '{"started_ns": 1e30}', "is not what a run leaves behind"),
    ],
)
def test_a_folder_with_something_else_in_it_is_refused_with_the_file(
    copied: Path, file: str, content: str, expected: str
) -> None:
    (copied / file).write_text(content)
    with pytest.raises(ServiceError, match=f"{file} {expected}"):
        write_report(copied)


def test_what_is_no_run_and_what_cannot_be_written(copied: Path, tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match=r"Is .* the folder of a run"):
        write_report(tmp_path / "nothing")
    (copied / "report.html").unlink(missing_ok=True)
    (copied / "report.html").mkdir()
    with pytest.raises(ServiceError, match="cannot be written"):
        write_report(copied)


def test_the_command_makes_each_report_anew_and_compares_several(formed: Path, aborted: Path, tmp_path: Path) -> None:
    app, out = typer.Typer(), tmp_path / "both.html"
    app.command()(report)
    (formed / "report.html").unlink(missing_ok=True)
    ran = CliRunner().invoke(app, [str(formed), str(aborted), "--out", str(out)])
    assert ran.exit_code == 0
    assert f"report {formed / 'report.html'}" in ran.output
    assert f"comparison {out}" in ran.output
    page = Page(out)
    require_harmless(page)
    assert page.count("span", class_="verdict formed") == page.count("span", class_="verdict aborted") == 1
    assert page.count("div", class_="map") == page.count("div", class_="bars") == 2
    assert "HELD" in page.text
    assert Page(formed / "report.html").count("div", class_="map") == 1


VERDICTS = [
    {"figure": "outcome", "condition": "== formed", "measured": "aborted", "passed": False, "stage": "relay"},
    {"figure": "overshoot_m", "condition": "< 1.0", "measured": None, "passed": False, "stage": ""},
    *(
        {"figure": f"placement_error_m.U{n}", "condition": "< 0.5", "measured": 0.25, "passed": True, "stage": ""}
        for n in range(1, 9)
    ),
]
STAGES = [
    {"name": "relay", "kind": "relay", "outcome": "failed", "began_s": 20.0, "ended_s": 80.0, "reason": "too late"},
    {"name": "down", "kind": "land", "outcome": "not_reached", "began_s": None, "ended_s": None, "reason": ""},
]


def test_what_was_expected_is_at_the_top_with_what_was_measured(copied: Path) -> None:
    change(copied / "report.json", verdicts=VERDICTS, stages=STAGES)
    page = Page(write_report(copied))
    require_harmless(page)
    assert page.count("span", class_="verdict failed") == 1
    assert page.count("span", class_="tick missed") == 2
    assert page.count("span", class_="tick met") == 8
    assert page.count("li", class_="not_reached") == 1
    top = page.text[: page.text.index("Planned legs")]
    for said in (
        "failed 2 of 10",
        "aborted",
        "not measured",
        "4 more that came true",
        "relay failed: too late",
        "down",
    ):
        assert said in top
    assert top.index("overshoot_m") < top.index("placement_error_m.U1")  # what failed comes first
    assert "60.0" in page.text  # how long the relay lasted


def test_everything_that_was_expected_came_true(copied: Path) -> None:
    change(copied / "report.json", verdicts=VERDICTS[2:5])
    page = Page(write_report(copied))
    assert page.count("span", class_="verdict passed") == 1
    assert page.count("span", class_="verdict plain") == 1
    assert "passed 3 of 3" in page.text
    assert page.count("details") == 2  # the bus and the playbook: no verdict is folded away


def test_measurements_are_shown(copied: Path) -> None:
    hovered = {"mean_m": 0.111, "median_m": 0.222, "rms_m": 0.333, "max_m": 0.444}
    measured = {"stage": "measure", "duration_s": 10.0, "samples": 50, "receivers": {"U1": hovered}}
    change(copied / "report.json", measurements=[measured])
    page = Page(write_report(copied))
    for said in ("0.11", "0.22", "0.33", "0.44"):
        assert said in page.text


def test_what_many_receivers_have_in_common_is_said_once(copied: Path) -> None:
    result = json.loads((copied / "report.json").read_text())
    for receiver in result["receivers"][:3]:
        receiver |= {"state": "HELD", "reason": "no bearing"}
    stage = {**STAGES[0], "reason": "U1 is held: no bearing"}
    change(copied / "report.json", receivers=result["receivers"], stages=[stage])
    page = Page(write_report(copied))
    names = ", ".join(receiver["name"] for receiver in result["receivers"][:3])
    assert f"{names} HELD: no bearing" in page.text
    assert page.text.count("relay failed") == 0


def test_runs_are_compared_by_what_was_expected_of_them(copied: Path, formed: Path, tmp_path: Path) -> None:
    change(copied / "report.json", verdicts=VERDICTS[:3])
    page = Page(write_comparison([copied, formed], tmp_path / "both.html"))
    require_harmless(page)
    assert page.count("span", class_="tick missed") == 2
    assert "failed 2 of 3" in page.text
    assert "placement_error_m.U1 < 0.5" in page.text
