"""`demo` and `fly`: a run, live on the screen."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from drivers.tasks import background
from gcs.commands.options import PlaybookPath, ReportPath, RunsDir, Seed, SigmaDeg, SitlChoice, Speedup, changed
from gcs.errors import ServiceError
from gcs.monitor.terminal import result_lines, result_table, show_progress
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.recording.run_folder import write_json
from gcs.relay.states import ReceiverState
from gcs.service import RunOptions
from gcs.service import fly as fly_playbook
from gcs.status import RunStatus


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


def fly(
    path: PlaybookPath,
    speedup: Speedup = 1.0,
    sitl: SitlChoice = None,
    sigma_deg: SigmaDeg = None,
    seed: Seed = 0,
    attended: Annotated[
        bool, typer.Option(help="somebody is there: when the relay holds, wait for their `bearing-relay control`")
    ] = False,
    json: ReportPath = None,
    runs_dir: RunsDir = Path("runs"),
) -> None:
    """Fly a playbook on the vehicles it names. Exit status 0 only when every receiver is PLACED."""
    options = RunOptions(runs_dir, speedup, seed, None if sitl is None else sitl.value, attended)
    _fly(load_playbook(path), options, sigma_deg, json)


def _fly(playbook: Playbook, options: RunOptions, sigma_deg: float | None, json: Path | None) -> None:
    playbook = changed(playbook, "sensor", sigma_deg=sigma_deg)
    made = playbook.plan()
    console = Console()

    @contextlib.asynccontextmanager
    async def show(status: RunStatus) -> AsyncIterator[None]:
        async with background(show_progress(console, status)):
            yield

    result = asyncio.run(fly_playbook(playbook, made, options, show))
    console.print(result_table(result.report))
    for line in result_lines(result.report):
        console.print(line, soft_wrap=True)
    for receiver in result.report["receivers"]:
        if receiver["reason"] and receiver["state"] != ReceiverState.PLACED.value:
            console.print(f"{receiver['name']} {receiver['state']}: {receiver['reason']}", style="red", soft_wrap=True)
    console.print(f"report {result.folder.path / 'report.html'}", soft_wrap=True)
    if json is not None:
        write_json(json, result.report)
    if result.report["outcome"] != "formed":
        raise typer.Exit(1)
