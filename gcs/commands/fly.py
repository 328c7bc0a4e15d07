"""`demo` and `fly`: a run, or every run of a playbook's matrix, live on the screen."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.console import Console
from rich.text import Text

from drivers.tasks import background
from gcs.commands.attending import enter_pressed
from gcs.commands.dry_run import foresight_lines
from gcs.commands.options import (
    DashboardPlace,
    OwnSeed,
    PlaybookPath,
    ReportPath,
    RunsDir,
    SigmaDeg,
    SitlChoice,
    Speedup,
    TargetChoice,
    changed,
)
from gcs.errors import ServiceError
from gcs.expectations import Verdict, all_passed, verdicts_of
from gcs.monitor.beside import dashboard_beside
from gcs.monitor.terminal import result_lines, result_table, show_progress
from gcs.playbook.loader import load_runs
from gcs.playbook.matrix import MatrixRun
from gcs.playbook.schema import Playbook
from gcs.playbook.target import aimed
from gcs.recording.run_folder import write_json
from gcs.relay.states import ReceiverState
from gcs.service import RunOptions, RunResult, Show
from gcs.service import fly as fly_playbook
from gcs.stages.foresight import foresee
from gcs.status import RunStatus
from planner.plan import RelayPlan


def demo(
    uavs: Annotated[int, typer.Option(help="how many of the paper's UAVs: 8 or 20")] = 8,
    speedup: Speedup = 1.0,
    sigma_deg: SigmaDeg = None,
    seed: OwnSeed = None,
    json: ReportPath = None,
    runs_dir: RunsDir = Path("runs"),
    dashboard: DashboardPlace = None,
) -> None:
    """Fly the paper's relay on embedded copters."""
    source = files("sitl_configs") / f"paper_{uavs}.yaml"
    if not source.is_file():
        raise ServiceError(f"there is no demo with {uavs} UAVs: the paper's cases are --uavs 8 and --uavs 20")
    with as_file(source) as path:
        runs = load_runs(path)
    _fly(runs, RunOptions(runs_dir, speedup, seed), sigma_deg, json, dashboard)


def fly(
    path: PlaybookPath,
    speedup: Speedup = 1.0,
    target: TargetChoice = None,
    sitl: SitlChoice = None,
    sigma_deg: SigmaDeg = None,
    seed: OwnSeed = None,
    attended: Annotated[
        bool, typer.Option(help="somebody is there: when the run holds or asks, wait for their `bearing-relay control`")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="say stage by stage what would be done, and open and fly nothing")
    ] = False,
    json: ReportPath = None,
    runs_dir: RunsDir = Path("runs"),
    dashboard: DashboardPlace = None,
) -> None:
    """Fly a playbook, every run of its matrix.

    Exit status 0 only when all that it expects came true, or where it expects nothing, when all its stages were done
    and every receiver is PLACED; and the report of it could be written.
    """
    if target is not None and sitl is not None:
        raise ServiceError("--sitl is the old word for --target: give one of them")
    runs, chosen = load_runs(path), target or (sitl if dry_run else None)
    if chosen is not None:
        runs = tuple(replace(run, playbook=aimed(run.playbook, chosen.value)) for run in runs)
    if dry_run:
        _foretell(runs, sigma_deg)
        return
    options = RunOptions(runs_dir, speedup, seed, None if sitl is None else sitl.value, attended)
    if attended and sys.stdin.isatty():
        options = replace(options, terminal=enter_pressed)
    _fly(runs, options, sigma_deg, json, dashboard)


def _fly(
    runs: Sequence[MatrixRun], options: RunOptions, sigma_deg: float | None, json: Path | None, dashboard: str | None
) -> None:
    planned = [(run, *_planned(run, sigma_deg)) for run in runs]
    console, reports, incomplete = Console(), list[Mapping[str, Any]](), False
    with dashboard_beside(dashboard, options.runs_dir) as address:
        if address is not None:
            console.print(f"dashboard at {address}", soft_wrap=True)
        for run, playbook, plan in planned:
            if run.label:
                console.print(Text(f"{playbook.name}: {run.label}", style="bold"))
            result = _flown(console, playbook, plan, replace(options, values=run.values))
            reports.append(result.report)
            incomplete = incomplete or bool(result.unwritten)
            if any(stage["outcome"] == "stopped" for stage in result.report["stages"]):
                break
        if address is not None and sys.stdin.isatty():
            console.input("Enter ends the dashboard ")
    if json is not None:
        write_json(json, reports if len(runs) > 1 else reports[0])
    if incomplete or len(reports) < len(runs) or not all(all_passed(verdicts_of(report)) for report in reports):
        raise typer.Exit(1)


def _planned(run: MatrixRun, sigma_deg: float | None) -> tuple[Playbook, RelayPlan]:
    playbook = changed(run.playbook, "sensor", sigma_deg=sigma_deg)
    return playbook, playbook.plan()


def _flown(console: Console, playbook: Playbook, plan: RelayPlan, options: RunOptions) -> RunResult:
    result = asyncio.run(fly_playbook(playbook, plan, options, shown_on(console)))
    print_result(console, result)
    return result


def shown_on(console: Console) -> Show:
    """Return what shows a run live on a console; where nobody reads that any more, the flight goes on unseen."""

    @contextlib.asynccontextmanager
    async def show(status: RunStatus) -> AsyncIterator[None]:
        async with background(_lasting(console, status)):
            yield

    return show


async def _lasting(console: Console, status: RunStatus) -> None:
    try:
        await show_progress(console, status)
    except (OSError, SystemExit):  # a pipe that is read no more, a full disk behind the screen
        console.quiet = True


def print_result(console: Console, result: RunResult) -> None:
    """Say what became of a run, and where its report is."""
    report = result.report
    console.print(result_table(report))
    for line in result_lines(report):
        console.print(line, soft_wrap=True)
    for receiver in report["receivers"]:
        if receiver["reason"] and receiver["state"] != ReceiverState.PLACED.value:
            console.print(f"{receiver['name']} {receiver['state']}: {receiver['reason']}", style="red", soft_wrap=True)
    for verdict in msgspec.convert(report["verdicts"], list[Verdict]):
        came_true = ("as expected ", "green") if verdict.passed else ("not as expected ", "bold red")
        console.print(Text.assemble(came_true, str(verdict)), soft_wrap=True)
    if result.unwritten:
        for problem in result.unwritten:
            console.print(problem, style="red", soft_wrap=True, markup=False, highlight=False)
        console.print(f"once there is room again: bearing-relay report {result.folder.path}", soft_wrap=True)
        return
    console.print(f"report {result.folder.path / 'report.html'}", soft_wrap=True)


def _foretell(runs: Sequence[MatrixRun], sigma_deg: float | None) -> None:
    console = Console(soft_wrap=True, highlight=False, markup=False)
    for run in runs:
        playbook, plan = _planned(run, sigma_deg)
        console.print(f"dry run: {playbook.name} {run.label}".rstrip())
        for line in foresight_lines(foresee(playbook, plan)):
            console.print(line)
