"""`test`: the playbooks of a folder flown one after another, and whether what they expect came true."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from drivers.tasks import background
from gcs.commands.options import RunsDir, TargetChoice
from gcs.expectations import STOPPED, Suite, all_passed, write_junit
from gcs.monitor.terminal import REFRESH_S, progress_view
from gcs.service import Show
from gcs.status import RunStatus
from gcs.trials import Trial, fly_trial, trials

_STYLES: Final = {"passed": "green", "failed": "bold red", "error": "bold red", "skipped": "dim"}


def run_tests(
    paths: Annotated[list[Path], typer.Argument(help="playbooks, and folders of them", metavar="PATH...")],
    target: TargetChoice = None,
    speedup: Annotated[
        float, typer.Option(help="embedded copters only: how much faster than real time", min=0.1, max=50.0)
    ] = 5.0,
    only: Annotated[str, typer.Option("-k", help="only runs with this in their name or path", metavar="NAME")] = "",
    slow: Annotated[bool, typer.Option("--slow", help="the playbooks marked slow, too")] = False,
    junit: Annotated[Path | None, typer.Option(help="write the verdicts here as JUnit XML, for CI")] = None,
    runs_dir: RunsDir = Path("runs"),
) -> None:
    """Fly playbooks and judge each run by what its playbook expects, or else by whether it formed up.

    Exit status 0 when all of it came true, 1 when not, 2 when a playbook could not be read or a run not be flown to its
    end, or when nothing was flown at all.
    """
    planned = trials(paths, None if target is None else target.value, slow=slow, only=only)
    console = Console()
    ended: list[Suite] = []
    if junit is not None:
        write_junit(junit, ended)  # where it cannot be written is said before the flights
    try:
        for number, trial in enumerate(planned):
            ended.append(fly_trial(trial, runs_dir, speedup, _screen(console, ended, planned[number:])))
            if not console.is_terminal:
                console.print(_line(ended[-1]), soft_wrap=True)
            if ended[-1].error == STOPPED:
                ended += [Suite(left.name, 0.0, skipped=STOPPED) for left in planned[number + 1 :]]
                break
    finally:
        if junit is not None:
            write_junit(junit, ended)
    console.print(_table(ended))
    for suite in ended:
        for line in _failures(suite):
            console.print(f"{suite.name}: {line}", style="red", soft_wrap=True, markup=False, highlight=False)
    counts = {state: sum(_state(suite) == state for suite in ended) for state in _STYLES}
    console.print(", ".join(f"{count} {state}" for state, count in counts.items() if count), soft_wrap=True)
    if counts["error"] or counts["skipped"] == len(ended):
        raise typer.Exit(2)
    if counts["failed"]:
        raise typer.Exit(1)


def _screen(console: Console, ended: Sequence[Suite], left: Sequence[Trial]) -> Show:
    """Return what shows on a terminal all runs and the one being flown; elsewhere a run is told when it has ended."""

    @contextlib.asynccontextmanager
    async def show(status: RunStatus) -> AsyncIterator[None]:
        async with background(_refresh(console, status, ended, left)):
            yield

    return show


async def _refresh(console: Console, status: RunStatus, ended: Sequence[Suite], left: Sequence[Trial]) -> None:
    if not console.is_terminal:
        return
    with Live(console=console, auto_refresh=False, transient=True) as live:
        while True:
            live.update(Group(_table(ended, left), progress_view(status)), refresh=True)
            await asyncio.sleep(REFRESH_S)


def _table(ended: Sequence[Suite], left: Sequence[Trial] = ()) -> Table:
    """Return a row for each run: what came of it, or that it is flown or waits."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("run", "", "expectations"):
        table.add_column(name, overflow="fold")
    table.add_column("s", justify="right")
    for suite in ended:
        state, met = _state(suite), sum(verdict.passed for verdict in suite.verdicts)
        counted = f"{met} of {len(suite.verdicts)} came true" if suite.verdicts else suite.skipped
        table.add_row(Text(suite.name), Text(state, style=_STYLES[state]), counted, f"{suite.duration_s:.1f}")
    for number, trial in enumerate(left):
        table.add_row(
            Text(trial.name), Text("flying" if number == 0 else "waits", style="cyan" if number == 0 else "dim")
        )
    return table


def _state(suite: Suite) -> str:
    if suite.error:
        return "error"
    if suite.skipped:
        return "skipped"
    return "passed" if all_passed(suite.verdicts) else "failed"


def _line(suite: Suite) -> Text:
    """Return a run that has ended, in a line."""
    state = _state(suite)
    return Text.assemble((f"{state:8}", _STYLES[state]), f"{suite.duration_s:7.1f} s  {suite.name}")


def _failures(suite: Suite) -> Iterator[str]:
    """Yield what did not come true, or why it was not flown, and where to look."""
    yield from suite.error.splitlines()
    yield from (str(verdict) for verdict in suite.verdicts if not verdict.passed)
    if _state(suite) == "failed":
        yield f"see {suite.folder}/report.html"
