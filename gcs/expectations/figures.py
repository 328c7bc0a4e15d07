"""The figures that a playbook may expect something of: each a name, what it means, and how report.json tells it.

A new figure is one entry of the registry. Some figures have a value for each of several things (receivers, stages,
links, kinds of refused reports): written alone they stand for one summary of them, and with something behind a dot for
one of them, as `placement_error_m.U3`, or for another summary, as `placement_error_m.p95`.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from gcs.expectations import reading
from gcs.expectations.condition import Value
from gcs.expectations.reading import ReadsOne, ReadsParts, Report
from gcs.playbook.suggestions import suggestion

SUMMARIES: Final[dict[str, Callable[[list[float]], float]]] = {
    "max": max,
    "min": min,
    "sum": math.fsum,
    "mean": statistics.fmean,
    "median": statistics.median,
    "p95": lambda values: reading.percentile(values, 0.95),
}

Parts = Literal["receiver", "stage", "link", "problem"]


@dataclass(frozen=True)
class Figure:
    """A figure that is one value of a run."""

    name: str
    meaning: str
    read: ReadsOne
    kind: Literal["number", "text"] = "number"
    choices: tuple[str, ...] = ()
    """What it may be, where it is one of a few words."""


@dataclass(frozen=True)
class PartedFigure:
    """A figure with a number for each of several things; `summary` is what it is when nothing stands behind it."""

    name: str
    meaning: str
    read: ReadsParts
    summary: str
    of: Parts = "receiver"
    kind: Literal["number"] = "number"


_ALL: Final = (
    Figure(
        "outcome",
        "what became of the run",
        reading.plain("outcome"),
        "text",
        choices=("formed", "completed", "aborted", "failed"),
    ),
    Figure("held_reason", "why receivers are not PLACED; empty when all are", reading.held_reason, "text"),
    Figure("receivers_placed", "how many receivers are PLACED", reading.number_in("PLACED")),
    Figure("receivers_held", "how many receivers are HELD", reading.number_in("HELD")),
    Figure("receivers_pilot", "how many receivers a pilot has", reading.number_in("PILOT")),
    Figure("receivers_failed", "how many receivers are FAILED", reading.number_in("FAILED")),
    PartedFigure(
        "placement_error_m",
        "how far from its slot a PLACED receiver says it stands",
        reading.of_receivers("placement_error_m", "PLACED"),
        "max",
    ),
    PartedFigure(
        "slot_distance_m",
        "how far from its slot a receiver says it is, PLACED or not",
        reading.of_receivers("placement_error_m"),
        "max",
    ),
    PartedFigure(
        "hover_error_m",
        "how far from its slot a receiver hovered on average in the latest `measure`",
        reading.latest_measurement("mean_m"),
        "max",
    ),
    PartedFigure(
        "hover_largest_m",
        "the farthest from its slot a receiver was in the latest `measure`",
        reading.latest_measurement("max_m"),
        "max",
    ),
    PartedFigure(
        "stop_error_deg",
        "how far the stops of its legs were off the stop angle",
        reading.of_legs("stop_angle_error_deg", max),
        "max",
    ),
    PartedFigure(
        "overshoot_m",
        "how far a receiver ran on its last leg beyond where it came to stand",
        reading.of_receivers("overshoot_m"),
        "max",
    ),
    PartedFigure("outliers", "bearings that did not agree with the others", reading.of_legs("outliers", sum), "sum"),
    PartedFigure(
        "setpoints_after_takeover",
        "setpoints sent to a receiver after its pilot had taken it",
        reading.of_receivers("setpoints_after_takeover"),
        "sum",
    ),
    PartedFigure("flown_length_m", "length flown", reading.of_legs("flown_length_m", math.fsum), "sum"),
    PartedFigure("planned_length_m", "length planned", reading.of_legs("planned_length_m", math.fsum), "sum"),
    Figure("length_ratio", "length flown to length planned", reading.length_ratio),
    Figure(
        "min_separation_m", "the nearest two vehicles came, one of them under way", reading.plain("min_separation_m")
    ),
    Figure("duration_s", "how long the run has lasted", reading.plain("duration_s")),
    PartedFigure(
        "stage_duration_s",
        "how long a stage lasted: this one, or at the end of the run the longest",
        reading.stage_durations_s,
        "max",
        "stage",
    ),
    Figure("stages_failed", "how many stages have failed", reading.stages_failed),
    Figure(
        "emission_transmitter_s",
        "seconds on the air, of all transmitters together",
        reading.plain("emission_transmitter_s"),
    ),
    Figure("bearings_received", "bearing reports that came", reading.bearings_received),
    PartedFigure("bearings_refused", "bearing reports refused", reading.bearings_refused, "sum", "problem"),
    PartedFigure("link_lost_share", "share of its messages a link lost", reading.link_lost_share, "max", "link"),
)

FIGURES: Final[dict[str, Figure | PartedFigure]] = {figure.name: figure for figure in _ALL}
"""Every figure by its name."""


def find_figure(written: str) -> tuple[Figure | PartedFigure, str]:
    """Return the figure that is written in a playbook, and what stands behind its dot, "" for nothing.

    ValueError with the nearest known figure, or with what may stand there.
    """
    name, dot, selector = written.partition(".")
    figure = FIGURES.get(name)
    if figure is None:
        raise ValueError(f"unknown figure{suggestion(name, FIGURES)}")
    if dot and isinstance(figure, Figure):
        raise ValueError(f"{name} is one value of the whole run: leave out {dot + selector!r}")
    if dot and not selector:
        raise ValueError(f"behind the dot belongs one of {', '.join(SUMMARIES)}")
    return figure, selector


def measured(written: str, report: Report, stage: str = "") -> Value | None:
    """Return what a report says of a figure as written, None where it does not: not measured, or nobody of that name.

    `stage` is the stage that asks: its own duration is meant when it names no other.
    """
    figure, selector = find_figure(written)
    if isinstance(figure, Figure):
        return figure.read(report)
    values = figure.read(report)
    if not selector and figure.of == "stage":
        selector = stage
    if selector in values:
        return values[selector]
    summary = SUMMARIES.get(selector or figure.summary)
    return summary(list(values.values())) if summary is not None and values else None
