"""Each leg as its stop condition saw it: the subtended angle over time, the stop angle, and the band about it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from gcs.recording.series import LegBegun
from gcs.reports.chart import Level, Line, Panel, draw, spread
from gcs.reports.markup import Content, Html, element
from gcs.reports.run_data import FlownLeg, RunData
from planner.angles import direction, wrap

_LAST_S: Final = 5.0
"""So much of a leg's end is shown enlarged."""
_STEP_M: Final = 0.01
_DIRECTIONS: Final = {"away": "away from"}


def leg_charts(data: RunData) -> Html:
    """Return a picture of every leg that was begun, in the order they were."""
    places = {name: complex(*transmitter.at) for name, transmitter in data.playbook.transmitters.items()}
    places |= {route.receiver: route.target for route in data.plan.routes}
    return element("div", [_leg(leg, places) for leg in data.legs], class_="cards")


def _leg(leg: FlownLeg, places: Mapping[str, complex]) -> Html:
    begun = leg.begun
    stop_deg = math.degrees(begun.stop_angle_rad)
    band_deg = math.degrees(begun.band_m * _slope(begun, places))
    points = [
        (time_s - leg.start_s, stop_deg + math.degrees(wrap(sample.angle_rad - begun.stop_angle_rad)))
        for time_s, sample in leg.samples
        if sample.angle_rad is not None
    ]
    title = f"{begun.receiver}, leg {begun.number}"
    return element(
        "figure",
        element(
            "figcaption",
            element("b", title),
            f" {_DIRECTIONS.get(begun.direction, begun.direction)} {begun.guide},"
            f" until {'→'.join(begun.stop_reference)} is {stop_deg:.2f}°",
            element("span", _ending(leg), class_="note"),
        ),
        _pictures(
            Line(points, f"leg-{min(begun.number, 3)}", "subtended angle"),
            Level(stop_deg, "stop", "stop angle", stop_deg - band_deg, stop_deg + band_deg),
            title,
        ),
    )


def _pictures(line: Line, stop: Level, title: str) -> Content:
    """Return the whole leg, and its last seconds enlarged until the band can be seen."""
    angles = {time_s: angle for time_s, angle in line.points if angle is not None}
    if not angles:
        return element("p", "no angle was measured on it", class_="note")
    end_s = max(angles)
    late_s = max(0.0, end_s - _LAST_S)
    far = spread([stop.at, *angles.values()])
    near = spread([stop.low, stop.high, *(angle for time_s, angle in angles.items() if time_s >= late_s)])
    whole = Panel((0.0, end_s), far, "s on the leg", "°", [line], [stop], width=300.0, height=180.0)
    enlarged = Panel((late_s, end_s), near, "its last seconds", "°", [line], [stop], width=220.0, height=180.0)
    return element(
        "div",
        draw(whole, f"{title}: subtended angle over time"),
        draw(enlarged, f"{title}: the last seconds, enlarged"),
        class_="pair",
    )


def _ending(leg: FlownLeg) -> str:
    if leg.end_s is None:
        return "did not reach its stop condition"
    error = "" if leg.stop_angle_error_rad is None else f", {math.degrees(leg.stop_angle_error_rad):+.3f}° off"
    return f"stopped after {leg.end_s - leg.start_s:.1f} s{error}; band ±{leg.begun.band_m:g} m"


def _slope(begun: LegBegun, places: Mapping[str, complex]) -> float:
    """Return by how much the subtended angle changes per metre at the leg's end, rad/m; 0 when that is not known."""
    start, end = complex(*begun.start_m), complex(*begun.end_m)
    if start == end or not all(name in places for name in begun.stop_reference):
        return 0.0
    course = (end - start) / abs(end - start)
    first, second = (places[name] for name in begun.stop_reference)
    before, after = (
        direction(second - place) - direction(first - place)
        for place in (end - course * _STEP_M / 2.0, end + course * _STEP_M / 2.0)
    )
    return abs(wrap(after - before)) / _STEP_M
