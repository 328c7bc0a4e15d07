"""JUnit XML: what CI servers count, whatever runs and reasons are called."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from gcs.errors import ServiceError
from gcs.expectations import STOPPED, Suite, Verdict, suite_of, write_junit
from tests.gcs.expectations.reports import report

MET = Verdict("outcome", "== formed", "formed", passed=True)
MISSED = Verdict("placement_error_m", "< 0.5", 0.9, passed=False, stage="relay")


def read(path: Path, *suites: Suite) -> list[ElementTree.Element]:
    write_junit(path, suites)
    root = ElementTree.parse(path).getroot()
    assert root.tag == "testsuites"
    return list(root)


def counts(suite: ElementTree.Element) -> tuple[int, ...]:
    return tuple(int(suite.attrib[name]) for name in ("tests", "failures", "errors", "skipped"))


def test_a_case_for_each_expectation(tmp_path: Path) -> None:
    [suite] = read(tmp_path / "junit.xml", Suite("eight seed=1", 93.25, [MET, MISSED], folder="runs/1"))
    assert counts(suite) == (2, 1, 0, 0)
    assert suite.attrib["time"] == "93.250"
    cases = suite.findall("testcase")
    assert [case.attrib["name"] for case in cases] == ["outcome == formed", "relay: placement_error_m < 0.5"]
    assert [case.attrib["classname"] for case in cases] == ["eight seed=1"] * 2
    failure = cases[1].find("failure")
    assert failure is not None
    assert failure.attrib["message"] == "relay: placement_error_m 0.9, expected < 0.5"
    assert suite.findtext("system-out") == "run folder runs/1"


@pytest.mark.parametrize(
    ("suite", "expected"),
    [
        (Suite("broken", 0.0, error="broken.yaml:3:1: unknown key"), (1, 0, 1, 0)),
        (Suite("long", 0.0, skipped="slow"), (1, 0, 0, 1)),
        (Suite("nothing expected", 3.0), (1, 0, 0, 0)),
        (Suite("half", 3.0, [MET], error="U1: no heartbeat"), (2, 0, 1, 0)),
    ],
)
def test_runs_that_could_not_be_judged(tmp_path: Path, suite: Suite, expected: tuple[int, ...]) -> None:
    [written] = read(tmp_path / "junit.xml", suite)
    assert counts(written) == expected


def test_what_xml_cannot_hold_is_replaced(tmp_path: Path) -> None:
    hostile = "\x1b[31m <&\"'> ]]> \x00\ud800\ufffe Ω"
    verdict = Verdict("held_reason", f"~ {hostile}", hostile, passed=False, stage=hostile)
    [suite] = read(tmp_path / "junit.xml", Suite(hostile, 1.0, [verdict], error=hostile, folder=hostile))
    assert counts(suite) == (2, 1, 1, 0)
    assert "<&\"'> ]]>" in suite.attrib["name"]


def test_a_file_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="cannot be written"):
        write_junit(tmp_path / "none" / "junit.xml", [])


def test_the_suite_of_a_run_is_made_from_its_report(tmp_path: Path) -> None:
    made = suite_of("three", report(verdicts=[MET.to_json(), MISSED.to_json()]), tmp_path)
    assert made.verdicts == [MET, MISSED]
    assert (made.duration_s, made.folder) == (90.0, str(tmp_path))
    assert made.error == STOPPED  # the third stage of that report
    [suite] = read(tmp_path / "junit.xml", made)
    assert counts(suite) == (3, 1, 1, 0)


def test_a_run_that_nobody_stopped_is_no_error(tmp_path: Path) -> None:
    assert suite_of("three", report(verdicts=[MET.to_json()], stages=[]), tmp_path, 5.0).error == ""
