"""`simulate`: a playbook flown many times over in virtual time, by itself or beside the paper's relay."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from gcs.commands.options import MethodName, PlaybookPath, Seed, SigmaDeg, changed
from gcs.errors import ServiceError
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.recording.run_folder import write_json
from gcs.reports.page import write_page
from gcs.simulate.comparison import Arm, arms_of, comparison
from gcs.simulate.comparison_page import comparison_page
from gcs.simulate.outcome import RunResult
from gcs.simulate.pictures import draw_placement_errors
from gcs.simulate.study import Study, StudyFolder, dask_pool, fly_study, local_pool, processors
from gcs.simulate.summary import placement_errors_m, require_writable, summary, write_rows
from gcs.simulate.world import Stop

_ALONE: Final = ""
"""The name of a study that is not compared: its folder is the study's."""
StopName = Enum("StopName", {"filtered": "filtered", "raw": "raw"}, type=str)


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
    stop: Annotated[
        StopName | None,
        typer.Option(help="how legs end: filtered, as they fly; raw, at constant speed, as in the paper"),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="fly the paper's chain with its raw stop too, and put both on a page")
    ] = False,
) -> None:
    """Fly a playbook many times in virtual time and say how far off it places. Runs differ in noise and gusts."""
    playbook = changed(load_playbook(path), "sensor", sigma_deg=sigma_deg)
    playbook = changed(changed(playbook, "flight", speed_mps=speed), "planner", method=method)
    if compare and (stop or csv or plots):
        raise ServiceError("--stop, --csv and --plots are of one study: leave out --compare, or leave them out")
    if csv is not None:
        require_writable(csv)
    console, seeds = Console(), range(seed, seed + runs)
    arms = arms_of(playbook) if compare else [_alone(playbook, "raw" if stop == StopName.raw else "filtered")]
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    folder = resume or studies_dir / f"{stamp}-{playbook.name}{'-compared' if compare else ''}"
    opened = StudyFolder.create if resume is None else StudyFolder.resume
    folders = {arm.name: opened(folder / arm.name, arm.study) for arm in arms}
    interrupted = _fly(arms, folders, seeds, jobs, dask, console)
    results = {name: [run for run in at.results() if run.seed in seeds] for name, at in folders.items()}
    for arm in arms:
        _show(arm.title, results[arm.name], console)
    console.print(f"study {folder}", soft_wrap=True)
    if compare:
        _write_comparison(arms, results, folder, json, console)
    else:
        _write_study(arms[0].title, results[_ALONE], json, csv, plots, console)
    if interrupted:
        console.print(f"interrupted: go on with --resume {folder}", style="red", soft_wrap=True)
        raise typer.Exit(130)


def _alone(playbook: Playbook, stop: Stop) -> Arm:
    """Return a playbook compared with nothing."""
    return Arm(_ALONE, playbook.name, Study(playbook, playbook.plan(), stop))


def _fly(
    arms: Sequence[Arm],
    folders: Mapping[str, StudyFolder],
    seeds: range,
    jobs: int | None,
    dask: str | None,
    console: Console,
) -> bool:
    """Fly what the folders do not hold yet; return whether that was interrupted."""
    try:
        with _pool(jobs, dask) as (pool, workers):
            for arm in arms:
                _fly_arm(arm.title, arm.study, folders[arm.name], seeds, pool, workers, console)
    except KeyboardInterrupt:
        return True
    return False


def _fly_arm(
    title: str, study: Study, folder: StudyFolder, seeds: range, pool: Executor, workers: int, console: Console
) -> None:
    with _progress(console, title, len(seeds)) as flown:
        flown(sum(run.seed in seeds for run in folder.results()))
        fly_study(study, seeds, folder, pool, workers, lambda _: flown(1))


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


def _show(title: str, results: Sequence[RunResult], console: Console) -> None:
    """Print what the runs of a study say."""
    told = summary(results)
    console.print(_summary_table(title, told))
    for reason, count in told["reasons"].items():
        console.print(f"{count} x {reason}", style="red", soft_wrap=True, markup=False)
    if told["min_separation_m"] is not None:
        console.print(f"closest approach {told['min_separation_m']:.1f} m")


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


def _write_comparison(
    arms: Sequence[Arm],
    results: Mapping[str, Sequence[RunResult]],
    folder: Path,
    json: Path | None,
    console: Console,
) -> None:
    told = comparison(arms, results)
    for path in (folder / "comparison.json", *([] if json is None else [json])):
        write_json(path, told)
    page = write_page(folder / "comparison.html", comparison_page(arms, results))
    console.print(f"comparison {page}", soft_wrap=True)


def _write_study(
    title: str, results: Sequence[RunResult], json: Path | None, csv: Path | None, plots: Path | None, console: Console
) -> None:
    if json is not None:
        write_json(json, summary(results))
    if csv is not None:
        write_rows(results, csv)
    if plots is not None:
        for picture in draw_placement_errors(placement_errors_m(results), plots, title):
            console.print(f"figure {picture}", soft_wrap=True)
