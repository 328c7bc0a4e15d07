"""`check`: look at every vehicle before the flight, and arm nothing."""

from __future__ import annotations

import asyncio
import contextlib
import json as json_text
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.table import Table

from drivers.clock import SystemClock
from drivers.mavlink.checks import Check, Verdict
from drivers.simulation.launcher import SimulatedTime, process_group
from drivers.simulation.sitl import SITLS
from gcs.commands.options import PlaybookPath, SitlChoice, SitlName, TargetChoice, TargetName
from gcs.errors import ServiceError
from gcs.links import open_links
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.playbook.target import aimed
from gcs.preflight.report import PreflightReport, alike
from gcs.preflight.run import Show, preflight
from gcs.simulated_vehicles import start_vehicles

_STYLES: Final = {Verdict.PASSED: "green", Verdict.SOFT: "yellow", Verdict.HARD: "bold red"}


def check(
    path: PlaybookPath,
    target: TargetChoice = None,
    sitl: SitlChoice = None,
    everything: Annotated[bool, typer.Option("--all", help="show the checks that passed, too")] = False,
    json: Annotated[bool, typer.Option("--json", help="print the report as JSON, and nothing else")] = False,
) -> None:
    """Check every vehicle of a playbook before it flies; nothing is armed or changed. Exit status 0 if all may arm."""
    playbook = _on_target(load_playbook(path), target, sitl)
    with _waiting_shown() as show:
        report = asyncio.run(_checked(playbook, show))
    if json:
        print(json_text.dumps({"playbook": playbook.name, **report.to_json()}, indent=2))  # noqa: T201 - the output
    else:
        console = Console()
        if shown := [found for found in report.checks if everything or found.verdict is not Verdict.PASSED]:
            console.print(check_table(shown))
        console.print(summary_table(report))
    if not report.may_arm:
        raise typer.Exit(1)


async def _checked(playbook: Playbook, show: Show) -> PreflightReport:
    """Open the links, start the vehicles where the playbook names none, and run the preflight."""
    sitl = SITLS.get(playbook.target or "")
    plan = playbook.plan()
    clock, real_time = SystemClock(), SimulatedTime(1.0, time.time_ns())
    async with contextlib.AsyncExitStack() as stack:
        logs = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="bearing-relay-")))
        group = await stack.enter_async_context(process_group(logs))
        vehicles = (await stack.enter_async_context(open_links(playbook, clock, sitl))).vehicles
        if playbook.vehicles is None:
            await start_vehicles(playbook, vehicles, group, real_time, sitl)
        return await preflight(vehicles, playbook, plan, show)


def _on_target(playbook: Playbook, target: TargetName | None, sitl: SitlName | None) -> Playbook:
    """Return the playbook as flown. ServiceError when it cannot be, SimulationError when the user has no simulator."""
    if sitl is not None and target is not None:
        raise ServiceError("--sitl is the old word for --target: give one of them")
    if sitl is not None and playbook.vehicles is not None:
        raise ServiceError("--sitl starts the vehicles itself: leave out 'vehicles' of the playbook")
    chosen = target or sitl
    playbook = aimed(playbook, None if chosen is None else chosen.value)
    if (simulator := SITLS.get(playbook.target or "")) is not None:
        simulator.find()
    return playbook


@contextlib.contextmanager
def _waiting_shown() -> Iterator[Show]:
    """Show on standard error what is waited for, where somebody looks."""
    waiting: dict[str, str] = {}
    with Console(stderr=True).status("opening the links") as line:

        def show(check: Check) -> None:
            if check.verdict is Verdict.RUNNING:
                waiting[check.vehicle] = f"{check.vehicle}: {check.found}"
            else:
                waiting.pop(check.vehicle, None)
            line.update("; ".join(waiting.values()))

        yield show


def check_table(checks: list[Check]) -> Table:
    """Return a row for each thing found, with every vehicle it was found of."""
    table = Table(title="preflight", title_style="bold", header_style="bold")
    for name in ("vehicles", "check", "verdict", "found", "way out"):
        table.add_column(name, overflow="fold")
    for names, found in alike(checks):
        verdict = f"[{_STYLES[found.verdict]}]{found.verdict.value}[/]"
        table.add_row(", ".join(names), found.name, verdict, _plain(found.found), _plain(found.way_out))
    return table


def summary_table(report: PreflightReport) -> Table:
    """Return a row for each vehicle: what it is, and how many checks came to what."""
    table = Table(title="may arm" if report.may_arm else "nothing may be armed", title_style="bold")
    for name in ("vehicle", "autopilot", "passed", "soft", "hard"):
        table.add_column(name, no_wrap=True)
    for name in dict.fromkeys(check.vehicle for check in report.checks):
        own = [check for check in report.checks if check.vehicle == name]
        counts = (
            sum(check.verdict is verdict for check in own) for verdict in (Verdict.PASSED, Verdict.SOFT, Verdict.HARD)
        )
        autopilot = next((check.found for check in own if check.name == "autopilot" and check.way_out == ""), "")
        table.add_row(name, autopilot, *map(str, counts))
    return table


def _plain(text: str) -> str:
    """Return a text without what rich would take for markup: autopilots say what they like."""
    return text.replace("[", r"\[")
