"""The stages of a run in its report: what became of each, when, and what was measured in them."""

from __future__ import annotations

from collections.abc import Sequence

from gcs.reports.markup import Content, Html, element, table
from gcs.reports.run_data import RunData
from gcs.reports.run_files import Measurement, StageResult
from gcs.reports.tables import NONE


def stage_strip(data: RunData) -> Content:
    """Return the stages one after another in a line, each with what became of it."""
    if data.result is None or not data.result.stages:
        return ""
    return element(
        "ol", [element("li", stage.name, class_=stage.outcome) for stage in data.result.stages], class_="stages"
    )


def stages_table(stages: Sequence[StageResult]) -> Html:
    """Return the stages with their times."""
    rows = [
        [element("b", stage.name), stage.kind, stage.outcome, _seconds(stage.began_s), _lasted(stage), stage.reason]
        for stage in stages
    ]
    return table(("stage", "kind", "outcome", "from s", "lasted s", "reason"), rows)


def measurements_table(measurements: Sequence[Measurement]) -> Html:
    """Return how far from their slots the receivers hovered."""
    rows = [
        [
            measurement.stage,
            f"{measurement.duration_s:.1f}",
            element("b", name),
            *(f"{value:.2f}" for value in (hovered.mean_m, hovered.median_m, hovered.rms_m, hovered.max_m)),
        ]
        for measurement in measurements
        for name, hovered in measurement.receivers.items()
    ]
    return table(("stage", "for s", "UAV", "mean m", "median m", "rms m", "largest m"), rows)


def _lasted(stage: StageResult) -> str:
    return _seconds(None if stage.began_s is None or stage.ended_s is None else stage.ended_s - stage.began_s)


def _seconds(time_s: float | None) -> str:
    return NONE if time_s is None else f"{time_s:.1f}"
