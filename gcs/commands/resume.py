"""`resume`: a run whose service has ended goes on."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from gcs.commands.attending import enter_pressed
from gcs.commands.fly import print_result, shown_on
from gcs.commands.options import ReportPath
from gcs.expectations import all_passed, verdicts_of
from gcs.recording.run_folder import write_json
from gcs.resume.left_run import read_left_run
from gcs.service import RunOptions
from gcs.service import resume as resume_run


def resume(
    run: Annotated[Path, typer.Argument(help="the folder of the run, as in runs/", metavar="RUN")],
    without: Annotated[
        list[str] | None, typer.Option(help="a vehicle that is done without from now on; again for each")
    ] = None,
    attended: Annotated[
        bool, typer.Option(help="somebody is there: when the run holds or asks, wait for their `bearing-relay control`")
    ] = False,
    json: ReportPath = None,
) -> None:
    """Go on with a run whose service was killed, or that was held: nobody takes off and nobody is armed.

    Who stands in a slot is verified from bearings first; who was on its way is located, and flies on from there. Exit
    status as of `fly`.
    """
    console, left = Console(), read_left_run(run)
    options = RunOptions(attended=attended, terminal=enter_pressed if attended and sys.stdin.isatty() else None)
    result = asyncio.run(resume_run(left, frozenset(without or ()), options, shown_on(console)))
    print_result(console, result)
    if json is not None:
        write_json(json, result.report)
    if not all_passed(verdicts_of(result.report)):
        raise typer.Exit(1)
