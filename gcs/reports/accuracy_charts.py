"""How near each receiver came to its slot and to others, and how well its angles told where it was."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from gcs.recording.series import Sample
from gcs.reports.chart import Level, Line, Panel, draw, spread
from gcs.reports.markup import Html, element
from gcs.reports.run_data import FlownLeg, RunData
from gcs.safety import SafetyLimits

_STYLES: Final = 8
_LEAST_M: Final = 0.01


def accuracy_charts(data: RunData) -> Html:
    """Return the charts of distance to the slot, error of the estimate, and separation, and whose line is which."""
    charts = (_to_slot(data), _estimate_error(data), _separation(data))
    legend = [[element("i", class_=f"line-{_style(data, name)}"), element("span", name)] for name in data.receivers]
    return element(
        "div", element("p", legend, class_="legend"), element("div", [c for c in charts if c], class_="cards")
    )


def _style(data: RunData, name: str) -> str:
    number = data.receivers.index(name)
    return f"{number % _STYLES}" + (" dashed" if number // _STYLES % 2 else "")


def _to_slot(data: RunData) -> Html | None:
    targets = {route.receiver: route.target for route in data.plan.routes}
    lines = _lines(data, lambda name, s: None if s.at_m is None else abs(complex(*s.at_m) - targets[name]))
    return _figure(
        "Distance to the slot", "by the positions the vehicles tell; m, logarithmic", data, lines, logarithmic=True
    )


def _separation(data: RunData) -> Html | None:
    planned_m = data.playbook.planner.min_separation_m
    share = SafetyLimits().separation_share
    levels = [
        Level(planned_m, "planned", f"planned: {planned_m:g} m"),
        Level(share * planned_m, "stop", f"a vehicle stops below {share * planned_m:g} m"),
    ]
    lines = _lines(data, lambda _, s: s.nearest_m)
    note = f"m; planned are {planned_m:g} m, below {share * planned_m:g} m a vehicle stops"
    return _figure("Separation from the nearest vehicle", note, data, lines, levels)


def _estimate_error(data: RunData) -> Html | None:
    """Return how far the place that follows from the angles of a leg was from the position told."""
    lines = []
    for name in data.receivers:
        points: list[tuple[float, float | None]] = []
        for leg in data.legs:
            if leg.begun.receiver == name:
                points += [*((time_s, _off_m(leg, sample)) for time_s, sample in leg.samples), (math.inf, None)]
        lines.append(Line(points, f"line-{_style(data, name)}", name))
    return _figure("Error of the estimate on the legs", "m, against the positions the vehicles tell", data, lines)


def _off_m(leg: FlownLeg, sample: Sample) -> float | None:
    start, end = complex(*leg.begun.start_m), complex(*leg.begun.end_m)
    if sample.at_m is None or sample.remaining_m is None or sample.cross_track_m is None or start == end:
        return None
    course = (end - start) / abs(end - start)
    return abs(end - course * complex(sample.remaining_m, -sample.cross_track_m) - complex(*sample.at_m))


def _lines(data: RunData, value: Callable[[str, Sample], float | None]) -> list[Line]:
    return [
        Line([(time_s, value(name, s)) for time_s, s in data.samples[name]], f"line-{_style(data, name)}", name)
        for name in data.receivers
        if name in data.samples
    ]


def _figure(
    title: str,
    note: str,
    data: RunData,
    lines: Sequence[Line],
    levels: Sequence[Level] = (),
    *,
    logarithmic: bool = False,
) -> Html | None:
    values = [y for line in lines for _, y in line.points if y is not None]
    if not values:
        return None
    shown = [*values, *(level.at for level in levels)]
    low, high = spread(shown)
    y = (max(_LEAST_M, min(shown)), max(*shown, 10 * _LEAST_M)) if logarithmic else (max(low, 0.0), high)
    panel = Panel((0.0, data.end_s), y, "s since the start", "m", lines, levels, logarithmic=logarithmic)
    return element(
        "figure",
        element("figcaption", element("b", title), element("span", note, class_="note")),
        draw(panel, f"{title} over time"),
    )
