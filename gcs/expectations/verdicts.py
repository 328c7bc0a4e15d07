"""Verdicts: whether what was expected came true, with what was measured."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from gcs.expectations.condition import Condition, Value
from gcs.expectations.figures import measured
from gcs.expectations.reading import Report


class Verdict(msgspec.Struct, frozen=True):
    """One expectation and what became of it; `measured` is None where the run did not tell, `stage` "" at its end."""

    figure: str
    condition: str
    measured: Value | None
    passed: bool
    stage: str = ""

    def __str__(self) -> str:
        """Return it in words."""
        found = "not measured" if self.measured is None else shown(self.measured)
        where = f"{self.stage}: " if self.stage else ""
        return f"{where}{self.figure} {found}, expected {self.condition}"

    def to_json(self) -> dict[str, Any]:
        """Return it as it stands under "verdicts" in report.json."""
        return dict(msgspec.to_builtins(self))


def judge(expectations: Mapping[str, Condition], report: Report, stage: str = "") -> list[Verdict]:
    """Return a verdict on each expectation, from the report of a run, or the report so far after a stage.

    Of a stage that was never reached nothing was measured, whatever the report says.
    """
    reached = all(each["outcome"] != "not_reached" for each in report.get("stages", ()) if each["name"] == stage)
    verdicts = []
    for written, condition in expectations.items():
        found = measured(written, report, stage) if reached else None
        verdicts.append(Verdict(written, str(condition), found, condition.holds(found), stage))
    return verdicts


def all_passed(verdicts: Iterable[Verdict]) -> bool:
    """Return whether every expectation came true."""
    return all(verdict.passed for verdict in verdicts)


def verdicts_of(report: Report) -> list[Verdict]:
    """Return the verdicts of a report; of a playbook that expects nothing, that all its stages were done."""
    verdicts = msgspec.convert(report["verdicts"], list[Verdict])
    if verdicts:
        return verdicts
    stages = [
        Verdict("stage", "== done", stage["outcome"], passed=stage["outcome"] == "done", stage=stage["name"])
        for stage in report["stages"]
    ]
    outcome = report["outcome"]
    return [*stages, Verdict("outcome", "== formed", outcome, passed=outcome in ("formed", "completed"))]


def shown(value: Value) -> str:
    """Return a measured value for a reader."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value or "(empty)"
    return f"{value:.4g}" if isinstance(value, float) and abs(value) < 1e4 else f"{value:.0f}"
