"""`faults`: a campaign of relays in virtual time in which things fail, watched for what must never happen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from gcs.commands.options import Seed
from gcs.errors import ServiceError
from gcs.faults.campaign import fly_campaign, summary
from gcs.faults.outcome import FaultRun
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.recording.run_folder import write_json
from gcs.simulate.study import local_pool, processors


def faults(
    path: Annotated[
        Path | None,
        typer.Argument(help="the playbook; by default the paper's eight", metavar="[PLAYBOOK]"),
    ] = None,
    runs: Annotated[
        int, typer.Option(help="how many relays, each with a seed and faults of its own", min=1, max=1_000_000)
    ] = 100,
    seed: Seed = 0,
    jobs: Annotated[int | None, typer.Option(help="processes; by default one for each processor", min=1)] = None,
    json: Annotated[Path | None, typer.Option("--json", help="write what was found here")] = None,
) -> None:
    """Fly relays in virtual time, each with a drawn fault or two, and look for what must never happen.

    Exit status 1 when it did. `--seed SEED --runs 1` repeats the run of that seed exactly.
    """
    playbook, console, workers = _playbook(path), Console(), jobs or processors()
    if json is not None:
        _require_writable(json)
    plan, columns = playbook.plan(), (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task(playbook.name, total=runs)
        with local_pool(workers) as pool:
            flown = fly_campaign(
                playbook, plan, range(seed, seed + runs), pool, workers, lambda _: progress.advance(task)
            )
    told = summary(playbook, seed, flown)
    if json is not None:
        write_json(json, told)
    _show(told, flown, console)
    if told["violations"]:
        raise typer.Exit(1)


def _require_writable(path: Path) -> None:
    """Say before anything is flown that the report cannot be written; what is there stays until then."""
    try:
        path.open("a").close()
    except OSError as error:
        raise ServiceError(f"{path} cannot be written: {error.strerror or error}") from error


def _playbook(path: Path | None) -> Playbook:
    if path is not None:
        return load_playbook(path)
    with as_file(files("sitl_configs") / "paper_8.yaml") as source:
        return load_playbook(source)


def _show(told: Mapping[str, Any], runs: Sequence[FaultRun], console: Console) -> None:
    """Print what was found: by fault, and each violation with what repeats it."""
    table = Table(title=f"{told['playbook']}: {told['runs']} runs, {len(told['violations'])} violations")
    table.add_column("fault")
    columns = ("runs", "formed", "held", "violations", "wrong_placements")
    for column in columns:
        table.add_column(column.replace("_", " "), justify="right")
    for kind, of_kind in told["by_fault"].items():
        table.add_row(kind, *(str(of_kind[column]) for column in columns))
    console.print(table)
    for run in runs:
        for found in run.violations:
            where = f"seed {run.seed}, {found.time_s:.1f} s: {found.vehicle or 'the relay'}"
            console.print(f"{found.invariant}: {where}: {found.what}", style="red", soft_wrap=True, markup=False)
