"""The command line: `bearing-relay COMMAND`."""

from __future__ import annotations

import asyncio
import contextlib
import math
import sys
import tempfile
import traceback
from collections.abc import AsyncIterator, Sequence
from enum import Enum
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, get_args

import typer
from rich.console import Console
from rich.table import Table

from drivers.errors import DriverError
from drivers.simulation.sitl import SITLS
from drivers.tasks import background
from gcs.errors import ServiceError, leaves
from gcs.monitor.terminal import result_lines, result_table, show_progress
from gcs.paper.plots import draw_paper_figures
from gcs.paper.render import print_paper
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.recording.run_folder import write_json
from gcs.relay.states import ReceiverState
from gcs.reports.canvas import extent_of
from gcs.reports.dilution_map import draw_dilution_map
from gcs.reports.figure import draw_plan
from gcs.service import RunOptions, fly
from gcs.status import RunStatus
from planner.errors import PlannerError
from planner.methods import METHODS
from planner.plan import RelayPlan, plan_to_json
from planner.relay import Objective
from planner.relay_accuracy import relay_accuracy

app = typer.Typer(
    name="bearing-relay",
    help="Bring a radio-quiet UAV swarm into formation from bearings alone.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

MethodName = Enum("MethodName", {name: name for name in METHODS}, type=str)  # type: ignore[misc]
ObjectiveName = Enum("ObjectiveName", {name: name for name in get_args(Objective)}, type=str)  # type: ignore[misc]
ReferenceName = Enum("ReferenceName", {"true_north": "true_north", "body": "body"}, type=str)
SitlName = Enum("SitlName", {name: name for name in SITLS}, type=str)  # type: ignore[misc]

PlaybookPath = Annotated[Path, typer.Argument(help="the playbook, a YAML file", metavar="PLAYBOOK")]
Speedup = Annotated[
    float, typer.Option(help="embedded copters only: how much faster than real time", min=0.1, max=50.0)
]
SitlChoice = Annotated[
    SitlName | None, typer.Option(help="fly on this autopilot's own simulator, in real time, from a program you have")
]
SigmaDeg = Annotated[
    float | None, typer.Option(help="bearing noise, one standard deviation, degrees", min=0.0, max=20.0)
]
Seed = Annotated[int, typer.Option(help="seed of the simulated noise")]
ReportPath = Annotated[Path | None, typer.Option("--json", help="write the run's report.json here too")]
RunsDir = Annotated[Path, typer.Option(help="where run folders are made")]


@app.command()
def demo(
    uavs: Annotated[int, typer.Option(help="how many of the paper's UAVs: 8 or 20")] = 8,
    speedup: Speedup = 1.0,
    sigma_deg: SigmaDeg = None,
    seed: Seed = 0,
    json: ReportPath = None,
    runs_dir: RunsDir = Path("runs"),
) -> None:
    """Fly the paper's relay on embedded copters."""
    source = files("sitl_configs") / f"paper_{uavs}.yaml"
    if not source.is_file():
        raise ServiceError(f"there is no demo with {uavs} UAVs: the paper's cases are --uavs 8 and --uavs 20")
    with as_file(source) as path:
        playbook = load_playbook(path)
    _fly(playbook, RunOptions(runs_dir, speedup, seed), sigma_deg, json)


@app.command(name="fly")
def fly_command(
    path: PlaybookPath,
    speedup: Speedup = 1.0,
    sitl: SitlChoice = None,
    sigma_deg: SigmaDeg = None,
    seed: Seed = 0,
    json: ReportPath = None,
    runs_dir: RunsDir = Path("runs"),
) -> None:
    """Fly a playbook on the vehicles it names. Exit status 0 only when every receiver is PLACED."""
    options = RunOptions(runs_dir, speedup, seed, None if sitl is None else sitl.value)
    _fly(load_playbook(path), options, sigma_deg, json)


@app.command()
def plan(
    path: PlaybookPath,
    method: Annotated[MethodName | None, typer.Option(help="planning method instead of the playbook's")] = None,
    objective: Annotated[
        ObjectiveName | None, typer.Option(help="what is minimised, instead of the playbook's")
    ] = None,
    min_separation: Annotated[
        float | None, typer.Option(help="separation in metres instead of the playbook's; 0 switches it off", min=0.0)
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
    playbook = _changed(playbook, "planner", method=method, objective=objective, tolerance_3sigma_m=tolerance_3sigma)
    playbook = _changed(playbook, "sensor", sigma_deg=sigma_deg, reference=reference)
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


@app.command()
def paper(
    plots: Annotated[Path | None, typer.Option(help="redraw figures 9 and 10 into this folder")] = None,
) -> None:
    """Recompute the paper's tables 2 to 6 beside the printed numbers."""
    console = Console()
    agrees = print_paper(console)
    if plots is not None:
        for path in draw_paper_figures(plots):
            console.print(f"figure {path}", soft_wrap=True)
    if not agrees:
        raise typer.Exit(1)


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
)
def copter(context: typer.Context) -> None:
    """Run one embedded copter for any MAVLink ground station (see copter --help)."""
    from drivers.simulation.copter import main as copter_main  # noqa: PLC0415 - the other commands do not need it

    raise typer.Exit(copter_main(context.args))


def _fly(playbook: Playbook, options: RunOptions, sigma_deg: float | None, json: Path | None) -> None:
    playbook = _changed(playbook, "sensor", sigma_deg=sigma_deg)
    made = playbook.plan()
    console = Console()

    @contextlib.asynccontextmanager
    async def show(status: RunStatus) -> AsyncIterator[None]:
        async with background(show_progress(console, status)):
            yield

    result = asyncio.run(fly(playbook, made, options, show))
    console.print(result_table(result.report))
    for line in result_lines(result.report):
        console.print(line, soft_wrap=True)
    for receiver in result.report["receivers"]:
        if receiver["reason"] and receiver["state"] != ReceiverState.PLACED.value:
            console.print(f"{receiver['name']} {receiver['state']}: {receiver['reason']}", style="red", soft_wrap=True)
    console.print(f"figure {result.figure}", soft_wrap=True)
    if json is not None:
        write_json(json, result.report)
    if result.report["outcome"] != "formed":
        raise typer.Exit(1)


def _changed(playbook: Playbook, section: str, **values: object) -> Playbook:
    """Return the playbook with the given values of one section replaced; None leaves a value as it is."""
    update = {name: getattr(value, "value", value) for name, value in values.items() if value is not None}
    return playbook.model_copy(update={section: getattr(playbook, section).model_copy(update=update)})


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


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; every known failure is one message on standard error and exit status 2."""
    complain = Console(stderr=True)
    try:
        app(args=list(arguments) if arguments is not None else None, prog_name="bearing-relay")
    except KeyboardInterrupt:
        complain.print(
            "bearing-relay: interrupted; a vehicle already in the air hovers in its guided mode", style="red"
        )
        sys.exit(130)
    except BaseException as error:  # the last line of defence: no traceback reaches a user
        if isinstance(error, SystemExit):
            raise
        for known in leaves(error):
            if isinstance(known, ServiceError | DriverError | PlannerError):
                complain.print(f"bearing-relay: {known}", style="red", markup=False, highlight=False, soft_wrap=True)
            else:
                complain.print(
                    f"bearing-relay: internal error: {known!r}; details in {_save(error)}",
                    style="red",
                    markup=False,
                    soft_wrap=True,
                )
        sys.exit(2)


def _save(error: BaseException) -> Path:
    """Keep the traceback of an internal error where the user can send it from."""
    with tempfile.NamedTemporaryFile("w", prefix="bearing-relay-", suffix=".txt", delete=False) as file:
        traceback.print_exception(error, file=file)
        return Path(file.name)


if __name__ == "__main__":
    main()
