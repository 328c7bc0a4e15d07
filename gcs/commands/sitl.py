"""`sitl`: a swarm of autopilots in their own simulators, up for any ground station to fly."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.table import Table

from drivers.simulation.sitl_keeper import KeptSwarm
from drivers.tasks import background
from gcs.commands.options import PlaybookPath, SitlName
from gcs.sitl_swarm import HOST, Progress, SwarmFolder, bring_up, running, take_down

REFRESH_S: Final = 0.2
_NAMED: Final = 4

app = typer.Typer(
    help="A swarm of autopilots in their own simulators, up for any ground station.", no_args_is_help=True
)
Folder = Annotated[Path, typer.Option(help="where the swarm keeps its playbook, state and logs")]
Autopilot = Annotated[SitlName, typer.Option(help="whose simulator, from a program you have")]


@app.command()
def up(path: PlaybookPath, autopilot: Autopilot, folder: Folder = Path("runs/sitl")) -> None:
    """Start a simulator for every UAV of a playbook; they stay up until `sitl down`."""
    console, began_s = Console(highlight=False), time.monotonic()
    swarm = SwarmFolder(folder)
    try:
        state = asyncio.run(_up(path, autopilot.value, swarm, console))
    except asyncio.CancelledError:
        console.print("interrupted: every simulator that was started has been ended", style="red")
        raise typer.Exit(130) from None
    console.print(_table(state))
    console.print(f"{len(state.vehicles)} vehicles ready after {time.monotonic() - began_s:.0f} s")
    console.print(f"fly them:  bearing-relay fly {swarm.playbook}", soft_wrap=True)
    console.print(f"end them:  bearing-relay sitl down --folder {folder}", soft_wrap=True)


@app.command()
def down(folder: Folder = Path("runs/sitl")) -> None:
    """End the simulators of a folder, and no other process."""
    ended = take_down(SwarmFolder(folder))
    Console(highlight=False).print(
        f"ended {', '.join(ended)}" if ended else f"no simulator is up in {folder}", soft_wrap=True
    )


@app.command()
def status(folder: Folder = Path("runs/sitl")) -> None:
    """Say which simulators run. Exit status 0: all, 1: not all, or none was started."""
    console, state = Console(highlight=False), SwarmFolder(folder).read()
    if state is None:
        console.print(f"no simulator is up in {folder}", soft_wrap=True)
        raise typer.Exit(1)
    console.print(_table(state))
    if len(running(state)) < len(state.vehicles):
        raise typer.Exit(1)


async def _up(path: Path, autopilot: str, folder: SwarmFolder, console: Console) -> KeptSwarm:
    @contextlib.asynccontextmanager
    async def show(progress: Progress) -> AsyncIterator[None]:
        with console.status("") as line:

            async def refresh() -> None:
                while True:
                    line.update(_words(progress))
                    await asyncio.sleep(REFRESH_S)

            async with background(refresh()):
                yield

    coming_up = asyncio.ensure_future(bring_up(path, autopilot, folder, show))
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, coming_up.cancel)
    return await coming_up


def _words(progress: Progress) -> str:
    """Return what is awaited of whom, the first few by name."""
    awaited: dict[str, list[str]] = {}
    for name, what in progress.waiting.items():
        awaited.setdefault(what, []).append(name)
    some = [
        f"{what}: {', '.join(names[:_NAMED])}" + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
        for what, names in awaited.items()
    ]
    return "; ".join([f"{len(progress.ready)} of {len(progress.vehicles)} ready", *some])


def _table(state: KeptSwarm) -> Table:
    table = Table(header_style="bold")
    for name in ("UAV", "system id", "link", "process", ""):
        table.add_column(name, no_wrap=True)
    for name, vehicle in state.vehicles.items():
        link = f"udpin:{HOST}:{vehicle.port}"
        table.add_row(
            name,
            str(vehicle.system_id),
            link,
            str(vehicle.process.pid),
            "runs" if vehicle.process.runs else "has ended",
        )
    return table
