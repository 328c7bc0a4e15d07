"""Several runs side by side on one page: their figures, receivers, maps, and relays on one scale of time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gcs.reports.bars import relay_gantt
from gcs.reports.markup import Content, Html, element, table
from gcs.reports.page import figures, page, plan_map, section, write_page
from gcs.reports.run_data import RunData, load_run
from gcs.reports.run_files import ReceiverResult
from gcs.reports.tables import NONE
from gcs.reports.verdicts import badge, compared_verdicts


def write_comparison(folders: Sequence[Path], path: Path) -> Path:
    """Write the comparison of the runs in these folders, and return its path. ServiceError as `write_report`."""
    return write_page(path, _page([load_run(folder) for folder in folders]))


def _page(runs: Sequence[RunData]) -> Html:
    names = [element("span", run.folder.resolve().name) for run in runs]
    longest_s = max(run.end_s for run in runs)
    content = [
        element("header", element("h1", f"{len(runs)} runs")),
        section("Figures", _figures(runs, names)),
        *_expectations(runs, names),
        section(
            "Placed off, m",
            _receivers(runs, names),
            note="How far each receiver says it stands from its slot, and its state where it is not PLACED.",
        ),
        section("Maps", _beside(names, [plan_map(run) for run in runs])),
        section("Relays", _beside(names, [relay_gantt(run, longest_s) for run in runs])),
    ]
    return page("Comparison of runs", element("main", content))


def _figures(runs: Sequence[RunData], names: Sequence[Content]) -> Html:
    of_run = [dict(figures(run)) for run in runs]
    kinds = list(dict.fromkeys(kind for found in of_run for kind in found))
    rows: list[list[Content]] = [["outcome", *(badge(run) for run in runs)]]
    rows += [[kind, *(found.get(kind, NONE) for found in of_run)] for kind in kinds]
    rows.append(["method", *(run.plan.method for run in runs)])
    rows.append(["seed", *(NONE if run.facts is None else f"{run.facts.seed}" for run in runs)])
    versions = ["?" if run.facts is None else run.facts.versions.get("bearing-relay", "?") for run in runs]
    rows.append(["bearing-relay", *versions])
    return table(["", *names], rows)


def _expectations(runs: Sequence[RunData], names: Sequence[Content]) -> list[Html]:
    rows = compared_verdicts(runs)
    return [section("Expectations", table(["", *names], rows))] if rows else []


def _receivers(runs: Sequence[RunData], names: Sequence[Content]) -> Html:
    results = [{} if run.result is None else {each.name: each for each in run.result.receivers} for run in runs]
    receivers = list(dict.fromkeys(name for run in runs for name in run.receivers))
    rows = [[element("b", name), *(_placed(found.get(name)) for found in results)] for name in receivers]
    return table(["UAV", *names], rows)


def _placed(receiver: ReceiverResult | None) -> str:
    if receiver is None:
        return NONE
    error = NONE if receiver.placement_error_m is None else f"{receiver.placement_error_m:.2f}"
    return error if receiver.state == "PLACED" else f"{error} {receiver.state}"


def _beside(names: Sequence[Content], parts: Sequence[Html]) -> Html:
    return element(
        "div",
        [element("figure", element("figcaption", name), part) for name, part in zip(names, parts, strict=True)],
        class_="cards",
    )
