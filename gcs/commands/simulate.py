"""`simulate`: a playbook flown many times over in virtual time."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from gcs.commands.options import MethodName, PlaybookPath, Seed, SigmaDeg, changed
from gcs.errors import ServiceError
from gcs.playbook.loader import load_playbook
from gcs.recording.run_folder import write_json
from gcs.simulate.outcome import RunResult
from gcs.simulate.pictures import draw_placement_errors
from gcs.simulate.study import StudyFolder, dask_pool, fly_study, local_pool, processors
from gcs.simulate.summary import placement_errors_m, require_writable, summary, write_rows


def simulate(
    path: PlaybookPath,
    runs: Annotated[int, typer.Option(help="how many relays, each with a seed of its own", min=1, max=1_000_000)] = 100,
    sigma_deg: SigmaDeg = None,
    speed: Annotated[
        float | None, typer.Option(help="flight speed, m/s, instead of the playbook's", min=0.5, max=10.0)
    ] = None,
    method: Annotated[MethodName | None, typer.Option(help="planning method instead of the playbook's")] = None,
    seed: Seed = 0,
    jobs: Annotated[int | None, typer.Option(help="processes; by default one for each processor", min=1)] = None,
    dask: Annotated[str | None, typer.Option(help="fly on the workers of this Dask scheduler, tcp://HOST:PORT")] = None,
    studies_dir: Annotated[Path, typer.Option(help="where study folders are made")] = Path("studies"),
    resume: Annotated[Path | None, typer.Option(help="go on with the study in this folder")] = None,
    json: Annotated[Path | None, typer.Option("--json", help="write the summary here")] = None,
    csv: Annotated[
        Path | None, typer.Option("--csv", help="write a row for each receiver and run here (.csv or .parquet)")
    ] = None,
    plots: Annotated[Path | None, typer.Option(help="draw the placement errors into this folder")] = None,
) -> None:
    """Fly a playbook many times in virtual time and say how far off it places. Runs differ in noise and gusts."""
    playbook = changed(load_playbook(path), "sensor", sigma_deg=sigma_deg)
    playbook = changed(changed(playbook, "flight", speed_mps=speed), "planner", method=method)
    if playbook.sensor.reference != "true_north":
        raise ServiceError("legs are flown along north-referenced bearings: sensor.reference must be true_north")
    if csv is not None:
        require_writable(csv)
    plan, console = playbook.plan(), Console()
    if resume is None:
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
        folder = StudyFolder.create(studies_dir / f"{stamp}-{playbook.name}", playbook, plan)
    else:
        folder = StudyFolder.resume(resume, playbook, plan)
    seeds = range(seed, seed + runs)
    interrupted = False
    try:
        with _pool(jobs, dask) as (pool, workers), _progress(console, playbook.name, runs) as flown:
            flown(sum(run.seed in seeds for run in folder.results()))
            fly_study(playbook, plan, seeds, folder, pool, workers, lambda _: flown(1))
    except KeyboardInterrupt:
        interrupted = True
    results = [run for run in folder.results() if run.seed in seeds]
    told = summary(results)
    console.print(_summary_table(playbook.name, told))
    for reason, count in told["reasons"].items():
        console.print(f"{count} x {reason}", style="red", soft_wrap=True, markup=False)
    if told["min_separation_m"] is not None:
        console.print(f"closest approach {told['min_separation_m']:.1f} m")
    console.print(f"study {folder.path}", soft_wrap=True)
    _write(told, results, json, csv)
    if plots is not None:
        for picture in draw_placement_errors(placement_errors_m(results), plots, playbook.name):
            console.print(f"figure {picture}", soft_wrap=True)
    if interrupted:
        console.print(f"interrupted: go on with --resume {folder.path}", style="red", soft_wrap=True)
        raise typer.Exit(130)


@contextlib.contextmanager
def _pool(jobs: int | None, dask: str | None) -> Iterator[tuple[Executor, int]]:
    """Yield what flies, and how many at a time."""
    if dask is not None:
        with dask_pool(dask) as pool_and_workers:
            yield pool_and_workers
    else:
        workers = jobs or processors()
        with local_pool(workers) as pool:
            yield pool, workers


@contextlib.contextmanager
def _progress(console: Console, name: str, runs: int) -> Iterator[Callable[[int], None]]:
    """Show a progress bar; yield what moves it on by so many runs."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(name, total=runs)
        yield lambda count: progress.advance(task, count)


def _summary_table(name: str, told: Mapping[str, Any]) -> Table:
    """Return the summary as a table: everything first, then the placement of each receiver."""
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in told["outcomes"].items())
    table = Table(title=f"{name}: {outcomes or 'nothing flown'}", title_style="bold", header_style="bold")
    table.add_column("")
    for column in ("median", "95 %", "largest"):
        table.add_column(column, justify="right")
    for label, key, digits in (
        ("placement error m", "placement_error_m", 2),
        ("its mean, hovering m", "hover_error_m", 2),
        ("stop error m", "stop_error_m", 2),
        ("overshoot m", "overshoot_m", 2),
        ("flown m", "flown_length_m", 1),
        ("duration s", "duration_s", 1),
        ("transmitter-seconds", "emission_transmitter_s", 0),
    ):
        table.add_row(label, *_numbers(told[key], digits))
    table.add_section()
    for receiver, of_one in told["by_receiver"].items():
        table.add_row(f"{receiver} in {of_one['slot']} m", *_numbers(of_one["placement_error_m"], 2))
    return table


def _numbers(spread: Mapping[str, float | None], digits: int) -> list[str]:
    return ["–" if value is None else f"{value:.{digits}f}" for value in spread.values()]


def _write(told: Mapping[str, Any], results: Sequence[RunResult], json: Path | None, csv: Path | None) -> None:
    if json is not None:
        write_json(json, told)
    if csv is not None:
        write_rows(results, csv)
