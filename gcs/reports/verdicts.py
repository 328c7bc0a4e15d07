"""What was expected of a run, and whether it came true: a badge, a table for the top of its report, a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from gcs.expectations.verdicts import Verdict, shown
from gcs.reports.markup import Content, Html, element, table
from gcs.reports.run_data import RunData
from gcs.reports.tables import NONE

_AT_ONCE: Final = 6
"""So many verdicts fit beside everything else on one screen; those that failed are always among them."""
_MET: Final = "✓"
_MISSED: Final = "✗"


def badge(data: RunData) -> Html:
    """Return the outcome in its colour; where something was expected, whether it came true comes first."""
    outcome = element("span", data.outcome, class_=f"verdict {data.outcome}")
    verdicts = [] if data.result is None else data.result.verdicts
    if not verdicts:
        return outcome
    met = all(verdict.passed for verdict in verdicts)
    expected = element("span", told(verdicts), class_=f"verdict {'passed' if met else 'failed'}")
    return element("span", expected, " ", element("span", data.outcome, class_="verdict plain"))


def told(verdicts: Sequence[Verdict]) -> str:
    """Return how many of the expectations came true."""
    met = sum(verdict.passed for verdict in verdicts)
    return f"passed {met} of {met}" if met == len(verdicts) else f"failed {len(verdicts) - met} of {len(verdicts)}"


def verdict_list(data: RunData) -> Content:
    """Return the expectations with what was measured, the failed ones first; the rest is folded away."""
    if data.result is None or not data.result.verdicts:
        return ""
    verdicts = sorted(data.result.verdicts, key=lambda verdict: verdict.passed)
    first = max(_AT_ONCE, sum(not verdict.passed for verdict in verdicts))
    if len(verdicts) <= first + 1:
        return _verdict_table(verdicts)
    rest = element("summary", f"{len(verdicts) - first} more that came true")
    return element("div", _verdict_table(verdicts[:first]), element("details", rest, _verdict_table(verdicts[first:])))


def _verdict_table(verdicts: Sequence[Verdict]) -> Html:
    rows = [
        [_mark(verdict), _figure(verdict), _measured(verdict), verdict.condition.removeprefix("== ")]
        for verdict in verdicts
    ]
    return table(("", "expected", "measured", "to be"), rows, class_="verdicts")


def compared_verdicts(runs: Sequence[RunData]) -> list[list[Content]]:
    """Return a row for everything that was expected of any of the runs, with what each measured."""
    of_run = [
        {} if run.result is None else {(v.stage, v.figure, v.condition): v for v in run.result.verdicts} for run in runs
    ]
    rows: list[list[Content]] = []
    for key in dict.fromkeys(key for found in of_run for key in found):
        verdicts = [found.get(key) for found in of_run]
        first = next(verdict for verdict in verdicts if verdict is not None)
        cells = [NONE if verdict is None else [_mark(verdict), " ", _measured(verdict)] for verdict in verdicts]
        rows.append([[_figure(first), f" {first.condition}"], *cells])
    return rows


def _mark(verdict: Verdict) -> Html:
    return element("span", _MET if verdict.passed else _MISSED, class_="tick met" if verdict.passed else "tick missed")


def _figure(verdict: Verdict) -> Html:
    return element("span", verdict.figure, element("small", verdict.stage) if verdict.stage else "")


def _measured(verdict: Verdict) -> Html:
    return element("b", "not measured" if verdict.measured is None else shown(verdict.measured))
