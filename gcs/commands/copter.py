"""`copter`: one embedded copter for any ground station."""

from __future__ import annotations

import typer


def copter(context: typer.Context) -> None:
    """Run one embedded copter for any MAVLink ground station (see copter --help)."""
    from drivers.simulation.copter import main as copter_main  # noqa: PLC0415 - the other commands do not need it

    raise typer.Exit(copter_main(context.args))
