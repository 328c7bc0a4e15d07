"""The tables of a report: receivers, routes, bearings and links, events, versions."""

from __future__ import annotations

import math
from typing import Final

from gcs.reports.markup import Content, Html, element, table
from gcs.reports.run_data import RunData
from gcs.reports.run_files import ReceiverResult, Result

NONE: Final = "–"


def receivers_table(data: RunData) -> Html:
    """Return what became of each receiver; from the plan alone when there is no result."""
    results = {} if data.result is None else {receiver.name: receiver for receiver in data.result.receivers}
    head = (
        *("UAV", "slot", "state", "route", "planned m", "flown m"),
        "stop errors °",
        "placed off m",
        "predicted 3σ m",
    )
    rows: list[list[Content]] = []
    for route in data.plan.routes:
        predicted = NONE if route.predicted_3sigma_m is None else f"{route.predicted_3sigma_m:.2f}"
        found = results.get(route.receiver)
        state = "?" if found is None else found.state
        rows.append(
            [
                element("b", route.receiver),
                route.slot,
                element("span", state, class_=f"state {state.lower()}"),
                route.model if found is None else found.route_model,
                f"{route.length_m:.2f}",
                NONE if found is None else f"{sum(leg.flown_length_m or 0.0 for leg in found.legs):.2f}",
                NONE if found is None else _stop_errors(found),
                NONE if found is None or found.placement_error_m is None else f"{found.placement_error_m:.2f}",
                predicted,
            ]
        )
    return table(head, rows)


def _stop_errors(receiver: ReceiverResult) -> str:
    errors = [leg.stop_angle_error_deg for leg in receiver.legs if leg.stop_angle_error_deg is not None]
    return "  ".join(f"{error:+.3f}" for error in errors) or NONE


def routes_table(data: RunData) -> Html:
    """Return the plan, a row for each leg."""
    rows = [
        [
            element("b", route.receiver) if number == 1 else "",
            f"{route.wave}",
            f"{number}",
            f"{leg.direction} {leg.guide}",
            "→".join(leg.stop_reference),
            f"{math.degrees(leg.stop_angle_rad):.2f}",
            f"{leg.length_m:.2f}",
        ]
        for route in data.plan.routes
        for number, leg in enumerate(route.legs, start=1)
    ]
    return table(("UAV", "wave", "leg", "flies", "between", "until °", "m"), rows)


def bearings_table(result: Result) -> Html:
    """Return what became of the bearing reports."""
    counts = result.bearing_reports
    return table([kind.replace("_", " ") for kind in counts], [[f"{count}" for count in counts.values()]])


def sensors_table(data: RunData) -> Html:
    """Return how the sensor of each receiver reported."""
    if data.traffic is None:
        return element("p", "not recorded", class_="note")
    rows = []
    for name, sensor in data.traffic.sensors.items():
        key = next((figures for key, figures in data.traffic.keys.items() if key.endswith(f"/{name}/bearings")), None)
        rows.append(
            [
                element("b", name),
                f"{sensor.reports}",
                _number(None if key is None else key.rate_hz, 1),
                f"{sensor.bearings / sensor.reports:.1f}",
                f"{sensor.missing}",
                f"{0 if key is None else key.unreadable}",
                f"{1000.0 * sensor.mean_age_s:.0f}",
                f"{1000.0 * sensor.longest_age_s:.0f}",
                _number(None if key is None else key.longest_gap_s, 2),
            ]
        )
    head = ("sensor", "reports", "Hz", "bearings each", "missing", "unreadable", "age ms", "oldest ms", "longest gap s")
    return table(head, rows)


def bus_table(data: RunData) -> Html:
    """Return what passed on every key of the bus."""
    if data.traffic is None:
        return element("p", "not recorded", class_="note")
    rows = [
        [key, f"{at.messages}", _number(at.rate_hz, 1), f"{at.size_bytes / 1000.0:.1f}", _number(at.longest_gap_s, 2)]
        for key, at in data.traffic.keys.items()
    ]
    return table(("key", "messages", "Hz", "kB", "longest gap s"), rows)


def links_table(result: Result) -> Html | None:
    """Return how each MAVLink link fared, or None where that was not noted."""
    if not result.links:
        return None
    heads = list(dict.fromkeys(key for link in result.links for key in link))
    rows = [[_plain(link.get(key)) for key in heads] for link in result.links]
    return table([head.replace("_", " ") for head in heads], rows)


def events_table(data: RunData) -> Html:
    """Return the journal."""
    rows = [
        [
            f"{event.time_s:.1f}",
            element("b", event.receiver),
            element("span", event.state, class_=f"state {event.state.lower()}"),
            event.text,
        ]
        for event in data.events
    ]
    return table(("s", "UAV", "state", "reason"), rows)


def versions_table(data: RunData) -> Html:
    """Return what the run was flown with."""
    if data.facts is None:
        return element("p", "not recorded", class_="note")
    started = [("seed", f"{data.facts.seed}"), ("speed-up", f"{data.facts.speedup:g}")]
    simulator = [] if data.facts.sitl is None else [("simulator", data.facts.sitl)]
    return table(("what", "which"), [*started, *simulator, *sorted(data.facts.versions.items())])


def _number(value: float | None, digits: int) -> str:
    return NONE if value is None else f"{value:.{digits}f}"


def _plain(value: object) -> str:
    if value is None:
        return NONE
    if isinstance(value, float):
        return f"{value:.3g}"
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
