"""The command line: `bearing-relay COMMAND`. Each command is a module of `gcs.commands`, and a line here."""

from __future__ import annotations

import io
import sys
import tempfile
import traceback
from collections.abc import Sequence
from pathlib import Path

import typer
from rich.console import Console

from drivers.errors import DriverError
from gcs.commands import keys, sitl
from gcs.commands.check import check
from gcs.commands.control import control
from gcs.commands.copter import copter
from gcs.commands.dashboard import dashboard
from gcs.commands.faults import faults
from gcs.commands.fly import demo, fly
from gcs.commands.link_node import link_node
from gcs.commands.monitor import monitor
from gcs.commands.paper import paper
from gcs.commands.plan import plan
from gcs.commands.replay import replay
from gcs.commands.report import report
from gcs.commands.resume import resume
from gcs.commands.schema import schema
from gcs.commands.sensor import sensor
from gcs.commands.simulate import simulate
from gcs.commands.test import run_tests
from gcs.errors import ServiceError, leaves
from planner.errors import PlannerError

app = typer.Typer(
    name="bearing-relay",
    help="Bring a radio-quiet UAV swarm into formation from bearings alone.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(sitl.app, name="sitl")
app.add_typer(keys.app, name="keys")
for command in (
    demo,
    plan,
    check,
    fly,
    resume,
    control,
    monitor,
    dashboard,
    simulate,
    faults,
    replay,
    report,
    sensor,
    link_node,
    schema,
    paper,
):
    app.command()(command)
app.command("test")(run_tests)
app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []})(
    copter
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; every known failure is one message on standard error and exit status 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # what cannot be written must not hide what is said
    complain = Console(stderr=True)
    try:
        app(args=list(arguments) if arguments is not None else None, prog_name="bearing-relay")
    except KeyboardInterrupt:
        complain.print(
            "bearing-relay: interrupted; a vehicle already in the air hovers in its guided mode", style="red"
        )
        sys.exit(130)
    except BaseException as error:  # the last line of defence: no traceback reaches a user
        if isinstance(error, SystemExit):
            raise
        for known in leaves(error):
            if isinstance(known, ServiceError | DriverError | PlannerError):
                complain.print(f"bearing-relay: {known}", style="red", markup=False, highlight=False, soft_wrap=True)
            else:
                complain.print(
                    f"bearing-relay: internal error: {known!r}; details in {_save(error)}",
                    style="red",
                    markup=False,
                    soft_wrap=True,
                )
        sys.exit(2)


def _save(error: BaseException) -> Path:
    """Keep the traceback of an internal error where the user can send it from."""
    with tempfile.NamedTemporaryFile(
        "w", prefix="bearing-relay-", suffix=".txt", delete=False, encoding="utf-8", errors="backslashreplace"
    ) as file:
        traceback.print_exception(error, file=file)
        return Path(file.name)


if __name__ == "__main__":
    main()
