"""report.html: a run on one page that needs nothing else, for wide and narrow screens, light and dark, and paper."""

from __future__ import annotations

import tempfile
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from typing import Final

from gcs.errors import ServiceError
from gcs.reports import tables
from gcs.reports.accuracy_charts import accuracy_charts
from gcs.reports.bars import emission_ledger, relay_gantt
from gcs.reports.complaints import complaints
from gcs.reports.figure import draw_plan
from gcs.reports.leg_charts import leg_charts
from gcs.reports.markup import Content, Html, element, joined, trusted
from gcs.reports.run_data import RunData, load_run
from gcs.reports.run_files import read_text
from gcs.reports.stages import measurements_table, stage_strip, stages_table
from gcs.reports.verdicts import badge, verdict_list

FILE: Final = "report.html"
_PLACED: Final = "PLACED"
_MAP_IN: Final = 5.5
"""Narrow, so that its writing can be read on a narrow screen."""


def write_report(folder: Path) -> Path:
    """Make report.html of a run from what is in its folder, and return its path.

    ServiceError when the folder is not a run's, or cannot be written to.
    """
    return write_page(folder / FILE, run_page(load_run(folder)))


def write_page(path: Path, content: Html) -> Path:
    """Write a page; ServiceError when it cannot be written."""
    try:
        path.write_text(content, encoding="utf-8")
    except OSError as error:
        raise ServiceError(f"{path} cannot be written: {error}") from error
    return path


def page(title: str, content: Content) -> Html:
    """Return a whole document; its style is in it, and it loads nothing."""
    style = files("gcs.reports").joinpath("report.css").read_text(encoding="utf-8")
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", title),
        element("style", trusted(style)),
    )
    return joined([trusted("<!DOCTYPE html>\n"), element("html", head, element("body", content), lang="en")])


def section(title: str, *content: Content | None, note: str = "") -> Html:
    """Return a part of a page under its heading."""
    told = element("p", note, class_="note") if note else ""
    shown = [part for part in content if part is not None]
    return element("section", element("h2", title), told, shown)


def run_page(data: RunData) -> Html:
    """Return the report of a run."""
    result = data.result
    statistics: list[Content | None] = [
        None if result is None else element("div", element("h3", "Bearing reports"), tables.bearings_table(result)),
        element("h3", "Sensors"),
        tables.sensors_table(data),
    ]
    if result is not None and (links := tables.links_table(result)) is not None:
        statistics += [element("h3", "Links"), links]
    statistics += [_folded("Every key of the bus", tables.bus_table(data))]
    content = [
        _header(data),
        section("Map", plan_map(data), note="Planned legs, and the tracks flown (thin, black). Metres, from L0."),
        section("Receivers", tables.receivers_table(data)),
        *_stages(data),
        section("Relay", relay_gantt(data), note="What each receiver did, and when."),
        section("On the air", emission_ledger(data), note="Which transmitters were on, and for how long."),
        section(
            "Stop conditions",
            leg_charts(data),
            note="The subtended angle on each leg, the stop angle (line) and what the stop may be off it (band).",
        ),
        section("Accuracy and separation", accuracy_charts(data)),
        section("Bearings, sensors and links", *statistics, note=_recording_note(data)),
        section("Events", tables.events_table(data)),
        section("Plan", tables.routes_table(data)),
        section("Playbook", _folded("As resolved", element("pre", data.playbook_text))),
        section("Versions", tables.versions_table(data)),
    ]
    return page(f"{data.playbook.name}: {data.outcome}", element("main", content))


def _header(data: RunData) -> Html:
    named = [data.folder.resolve().name]
    if data.facts is not None:
        named.append(f"{datetime.fromtimestamp(data.facts.started_ns * 1e-9, UTC):%Y-%m-%d %H:%M:%S} UTC")
    return element(
        "header",
        element("p", " · ".join(named), class_="note"),
        element("h1", data.playbook.name, " ", badge(data)),
        stage_strip(data),
        complaints(data),
        verdict_list(data),
        element("dl", [element("div", element("dt", name), element("dd", value)) for name, value in figures(data)]),
    )


def _stages(data: RunData) -> list[Html]:
    """Return what became of the stages, and what was measured in them, where the run had any."""
    if data.result is None:
        return []
    found = [section("Stages", stages_table(data.result.stages))] if data.result.stages else []
    if data.result.measurements:
        note = "How far from its slot each receiver said it was while it hovered."
        found.append(section("Measured", measurements_table(data.result.measurements), note=note))
    return found


def figures(data: RunData) -> list[tuple[str, str]]:
    """Return the figures a run is first judged by."""
    result = data.result
    if result is None:
        return [("recorded", f"{data.end_s:.0f} s")]
    placed = [receiver for receiver in result.receivers if receiver.state == _PLACED]
    errors = [receiver.placement_error_m for receiver in placed if receiver.placement_error_m is not None]
    separation = result.min_separation_m
    return [
        ("placed", f"{len(placed)} of {len(result.receivers)}"),
        ("flown", f"{result.flown_total_length_m:.1f} m"),
        ("planned", f"{result.planned_total_length_m:.1f} m"),
        ("straight lines", f"{result.straight_line_bound_m:.1f} m"),
        ("worst placed", f"{max(errors):.2f} m" if errors else tables.NONE),
        ("closest", tables.NONE if separation is None else f"{separation:.1f} m"),
        ("duration", f"{result.duration_s:.0f} s"),
        ("on the air, all", f"{result.emission_transmitter_s:.0f} s"),
    ]


def _recording_note(data: RunData) -> str:
    names = [] if data.traffic is None else data.traffic.files
    return f"Every message is in {', '.join(names)} (opens in Foxglove)." if names else ""


def _folded(title: str, content: Content) -> Html:
    return element("details", element("summary", title), content)


def plan_map(data: RunData) -> Html:
    """Return the figure of the plan with the tracks flown, as SVG within the page."""
    transmitters = {name: complex(*transmitter.at) for name, transmitter in data.playbook.transmitters.items()}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.svg"
        draw_plan(data.plan, transmitters, path, tracks=data.tracks, width_in=_MAP_IN)
        drawn = read_text(path)
    return element("div", trusted(drawn[drawn.index("<svg") :]), class_="map")
