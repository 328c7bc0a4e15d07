"""`plan`: assignment, order, routes and lengths, without flying."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from gcs.commands.options import MethodName, ObjectiveName, PlaybookPath, ReferenceName, SigmaDeg, changed
from gcs.playbook.loader import load_playbook
from gcs.recording.run_folder import write_json
from gcs.reports.canvas import extent_of
from gcs.reports.dilution_map import draw_dilution_map
from gcs.reports.figure import draw_plan
from planner.methods import METHODS
from planner.plan import RelayPlan, plan_to_json
from planner.relay_accuracy import relay_accuracy


def plan(
    path: PlaybookPath,
    method: Annotated[MethodName | None, typer.Option(help="planning method instead of the playbook's")] = None,
    objective: Annotated[
        ObjectiveName | None, typer.Option(help="what is minimised, instead of the playbook's")
    ] = None,
    min_separation: Annotated[
        float | None,
        typer.Option(help="separation in metres instead of the playbook's; 0 switches it off", min=0.0, max=10_000.0),
    ] = None,
    tolerance_3sigma: Annotated[
        float | None, typer.Option(help="largest predicted placement error, 3 sigma, metres", min=0.0)
    ] = None,
    sigma_deg: SigmaDeg = None,
    reference: Annotated[
        ReferenceName | None, typer.Option(help="what bearings refer to, instead of the playbook's")
    ] = None,
    json: Annotated[Path | None, typer.Option("--json", help="write plan.json here")] = None,
    plot: Annotated[Path | None, typer.Option(help="draw the plan here (.svg, .png or .pdf)")] = None,
    dilution: Annotated[
        Path | None, typer.Option(help="draw a map here of how well the first transmitters fix a position (GDOP)")
    ] = None,
) -> None:
    """Plan a playbook: assignment, order, two-leg routes, lengths."""
    playbook = load_playbook(path)
    playbook = changed(playbook, "planner", method=method, objective=objective, tolerance_3sigma_m=tolerance_3sigma)
    playbook = changed(playbook, "sensor", sigma_deg=sigma_deg, reference=reference)
    problem = playbook.problem(min_separation)
    made = METHODS[playbook.planner.method](problem)
    console = Console()
    console.print(_plan_table(made))
    console.print(
        f"{made.method}: total {made.total_length_m:.2f} m (straight lines {made.straight_line_bound_m:.2f} m), "
        f"makespan {made.makespan_s:.0f} s, {made.emission_transmitter_s:.0f} transmitter-seconds",
        soft_wrap=True,
    )
    if json is not None:
        write_json(json, plan_to_json(made))
    if plot is not None:
        accuracy = relay_accuracy(problem, made.routes)
        draw_plan(made, problem.transmitters, plot, title=playbook.name, accuracy=accuracy)
    if dilution is not None:
        field = (*problem.transmitters.values(), *problem.receivers.values(), *problem.slots.values())
        referenced = problem.heading_referenced
        draw_dilution_map(problem.transmitters, dilution, extent_of(field, margin=0.2), referenced, title=playbook.name)


def _plan_table(made: RelayPlan) -> Table:
    """Return the plan as a table: a row for each leg, what concerns the whole route in the first."""
    table = Table(title=f"relay plan, method {made.method}", title_style="bold", header_style="bold")
    for name in ("wave", "UAV", "slot", "leg"):
        table.add_column(name, no_wrap=True)
    table.add_column("m", justify="right")
    table.add_column("until °", justify="right")
    table.add_column("between", no_wrap=True)
    for name in ("route m", "3 sigma m"):
        table.add_column(name, justify="right")
    for route in made.routes:
        predicted = "–" if route.predicted_3sigma_m is None else f"{route.predicted_3sigma_m:.2f}"
        head = (str(route.wave), route.receiver, route.slot), (f"{route.length_m:.2f}", predicted)
        for leg in route.legs:
            angle = f"{math.degrees(leg.stop_angle_rad):.2f}"
            flown = (f"{leg.direction} {leg.guide}", f"{leg.length_m:.2f}", angle, "→".join(leg.stop_reference))
            table.add_row(*head[0], *flown, *head[1])
            head = ("", "", ""), ("", "")
        if not route.legs:
            table.add_row(*head[0], "stays", "0.00", "", "", *head[1])
        table.add_section()
    return table
