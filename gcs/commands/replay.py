"""`replay`: a run's recording decided and shown once more."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivers.clock import SystemClock
from gcs.replay.monitors import Flight, Stop
from gcs.replay.run import RunReplay
from gcs.replay.screen import watch
from gcs.replay.settings import NAMES, read_changes


def replay(
    run: Annotated[Path, typer.Argument(help="the folder of a run, as in runs/", metavar="RUN")],
    speed: Annotated[
        float | None, typer.Option(help="show the run as it was flown, so many times as fast", min=0.1, max=1000.0)
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help=f"what would another setting decide? {', '.join(NAMES)}"),
    ] = None,
) -> None:
    """Tell every stop monitor of a run again what it was told, and compare what it decides with what it decided.

    Exit status 0 only when every decision comes out to the sample, of a recording that is whole.
    """
    replayed, console = RunReplay(run, read_changes(settings or ())), Console(highlight=False)
    if speed is None:
        for _ in replayed.messages():
            pass
    else:
        asyncio.run(watch(replayed, SystemClock(speed), console))
    flights = replayed.flights
    console.print(_table(replayed, flights))
    _sum_up(console, replayed, flights)
    if not flights or not replayed.sound:
        raise typer.Exit(1)


def _table(replayed: RunReplay, flights: list[Flight]) -> Table:
    table = Table(title=Text(f"{replayed.name}: stop decisions"), title_style="bold", header_style="bold")
    table.box, table.pad_edge = None, False
    for name in ("UAV", "leg"):
        table.add_column(name, no_wrap=True)
    for name in ("stop s", "at rest, m", "replay s", "at rest, m"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("decision")
    for flight in flights:
        table.add_row(
            Text(flight.receiver),
            Text(flight.what),
            *_stop(replayed, flight.recorded, None),
            *_stop(replayed, flight.replayed, flight.last_at_rest),
            Text(_verdict(flight), style="" if flight.identical else "red"),
        )
    return table


def _stop(replayed: RunReplay, stop: Stop | None, last_at_rest: complex | None) -> tuple[str, str]:
    """Return when a receiver was told to stop and where that brings it to rest: along the leg from its end, left."""
    at_rest = last_at_rest if stop is None else stop.at_rest
    return (
        "–" if stop is None else f"{replayed.since_began_s(stop.time_ns):.2f}",
        "" if at_rest is None else f"{at_rest.real:+.2f} {at_rest.imag:+.2f}",
    )


def _verdict(flight: Flight) -> str:
    """Return what the replay decided, beside the record: how much later, s."""
    recorded, now = flight.recorded, flight.replayed
    if flight.difference is not None:
        return flight.difference
    if now is None or recorded is None:
        return "identical" if recorded is now else "no stop" if now is None else "stop"
    if now.sample == recorded.sample:
        return "identical"
    return f"{(now.time_ns - recorded.time_ns) * 1e-9:+.1f} s"


def _sum_up(console: Console, replayed: RunReplay, flights: list[Flight]) -> None:
    alike, samples = sum(flight.identical for flight in flights), sum(flight.samples for flight in flights)
    rounding_m = max((flight.largest_difference_m for flight in flights), default=0.0)
    console.print(
        f"{alike} of {len(flights)} flights decided as recorded, {samples} samples; "
        f"places differ by {rounding_m:.1g} m at most",
        soft_wrap=True,
    )
    wrong = list(replayed.complaints)
    if not flights:
        wrong.append("no stop monitor is in the recording: nobody flew a leg, or an older version recorded it")
    if replayed.audit.unsaid:
        wrong.append(f"{replayed.audit.unsaid} reports that monitors took in are not on the recorded bus")
    for line in wrong:
        console.print(line, style="red", soft_wrap=True, markup=False)
