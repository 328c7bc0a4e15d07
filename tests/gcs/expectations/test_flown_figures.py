"""Every figure of a flown relay is measured, and is what it can be: flown by the real executor in virtual time."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gcs.expectations import FIGURES, measured
from tests.gcs.reports.virtual_run import fly

NOT_FLOWN = {"setpoints_after_takeover", "hover_error_m", "hover_largest_m", "stage_duration_s", "link_lost_share"}
"""Nobody takes over, nothing is measured while hovering, and there are neither stages nor links in virtual time."""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = fly(tmp_path_factory.mktemp("runs"))
    return dict(json.loads((folder / "report.json").read_text()))


@pytest.mark.parametrize("name", [name for name in FIGURES if name not in NOT_FLOWN])
def test_a_figure_is_measured(report: dict[str, Any], name: str) -> None:
    assert measured(name, report) is not None


def test_receivers_run_on_a_little_and_hardly_a_bearing_disagrees(report: dict[str, Any]) -> None:
    runs_m = [measured(f"overshoot_m.U{number}", report) for number in range(1, 9)]
    assert all(isinstance(run_m, float) and 0.0 <= run_m < 1.0 for run_m in runs_m)
    assert max(runs_m) > 0.0
    received, outliers = measured("bearings_received", report), measured("outliers", report)
    assert isinstance(outliers, float | int)
    assert isinstance(received, float | int)
    assert outliers < 0.01 * received
