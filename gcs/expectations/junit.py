"""JUnit XML: the verdicts of runs for CI, a suite for each run and a case for each expectation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from gcs.errors import ServiceError
from gcs.expectations.reading import Report
from gcs.expectations.verdicts import Verdict, verdicts_of

STOPPED: Final = "stopped by the operator"
"""What is wrong with a run that somebody has ended, and with all that were to be flown after it."""

_NOT_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True)
class Suite:
    """One run. `error` says why it could not be flown or did not end as it should, "" when it did."""

    name: str
    duration_s: float
    verdicts: Sequence[Verdict] = ()
    error: str = ""
    skipped: str = ""
    folder: str = ""


def suite_of(name: str, report: Report, folder: Path, duration_s: float | None = None) -> Suite:
    """Return the suite of a run that left this report, in a folder; one that somebody has ended is an error.

    It took as long as the report says, unless otherwise given.
    """
    stopped = any(stage["outcome"] == "stopped" for stage in report["stages"])
    lasted_s = report["duration_s"] if duration_s is None else duration_s
    return Suite(name, lasted_s, verdicts_of(report), error=STOPPED if stopped else "", folder=str(folder))


def write_junit(path: Path, suites: Sequence[Suite]) -> None:
    """Write the suites in the form that CI servers read. ServiceError when the file cannot be written."""
    root = ElementTree.Element("testsuites")
    for suite in suites:
        root.append(_suite(suite))
    ElementTree.indent(root)
    try:
        ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise ServiceError(f"{path} cannot be written: {error}") from error


def _suite(suite: Suite) -> ElementTree.Element:
    cases = [_case(suite, verdict) for verdict in suite.verdicts]
    if suite.error or suite.skipped or not cases:
        cases.append(_of_the_run(suite))
    element = ElementTree.Element(
        "testsuite",
        name=_clean(suite.name),
        tests=f"{len(cases)}",
        failures=f"{sum(case.find('failure') is not None for case in cases)}",
        errors=f"{sum(case.find('error') is not None for case in cases)}",
        skipped=f"{sum(case.find('skipped') is not None for case in cases)}",
        time=f"{suite.duration_s:.3f}",
    )
    element.extend(cases)
    if suite.folder:
        ElementTree.SubElement(element, "system-out").text = _clean(f"run folder {suite.folder}")
    return element


def _case(suite: Suite, verdict: Verdict) -> ElementTree.Element:
    name = f"{verdict.stage}: {verdict.figure}" if verdict.stage else verdict.figure
    case = ElementTree.Element("testcase", classname=_clean(suite.name), name=_clean(f"{name} {verdict.condition}"))
    if not verdict.passed:
        ElementTree.SubElement(case, "failure", message=_clean(str(verdict)))
    return case


def _of_the_run(suite: Suite) -> ElementTree.Element:
    case = ElementTree.Element("testcase", classname=_clean(suite.name), name="run", time=f"{suite.duration_s:.3f}")
    if suite.error:
        ElementTree.SubElement(case, "error", message=_clean(suite.error))
    elif suite.skipped:
        ElementTree.SubElement(case, "skipped", message=_clean(suite.skipped))
    return case


def _clean(text: str) -> str:
    """Return a text without what XML cannot hold, even escaped: reasons come from anywhere."""
    return _NOT_XML.sub("\ufffd", text)
