"""Options that several commands take, and a playbook changed by them."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated, get_args

import typer

from drivers.simulation.sitl import SITLS
from gcs.playbook.schema import Playbook, Target
from planner.methods import METHODS
from planner.relay import Objective

MethodName = Enum("MethodName", {name: name for name in METHODS}, type=str)  # type: ignore[misc]
ObjectiveName = Enum("ObjectiveName", {name: name for name in get_args(Objective)}, type=str)  # type: ignore[misc]
ReferenceName = Enum("ReferenceName", {"true_north": "true_north", "body": "body"}, type=str)
SitlName = Enum("SitlName", {name: name for name in SITLS}, type=str)  # type: ignore[misc]
TargetName = Enum("TargetName", {name: name for name in get_args(Target)}, type=str)  # type: ignore[misc]

PlaybookPath = Annotated[Path, typer.Argument(help="the playbook, a YAML file", metavar="PLAYBOOK")]
Speedup = Annotated[
    float, typer.Option(help="embedded copters only: how much faster than real time", min=0.1, max=50.0)
]
TargetChoice = Annotated[
    TargetName | None,
    typer.Option(help="what to fly on, instead of the playbook's target: the same playbook flies on all"),
]
SitlChoice = Annotated[
    SitlName | None, typer.Option(help="fly on this autopilot's own simulator, in real time, from a program you have")
]
SigmaDeg = Annotated[
    float | None, typer.Option(help="bearing noise, one standard deviation, degrees", min=0.0, max=20.0)
]
Seed = Annotated[int, typer.Option(help="seed of the simulated noise")]
OwnSeed = Annotated[int | None, typer.Option(help="seed of the simulated noise, instead of the playbook's")]
ReportPath = Annotated[Path | None, typer.Option("--json", help="write the run's report.json here too")]
DashboardPlace = Annotated[
    str | None, typer.Option(help="serve the dashboard beside it, at HOST:PORT on loopback: 127.0.0.1:8080")
]
BusKeys = Annotated[
    Path | None, typer.Option("--keys", help="your file of `keys init`, where the bus is closed to strangers")
]
InsecureBus = Annotated[
    bool, typer.Option("--insecure", help="join a bus off loopback that is not closed: strangers can join it too")
]
RunsDir = Annotated[Path, typer.Option(help="where run folders are made")]


def changed(playbook: Playbook, section: str, **values: object) -> Playbook:
    """Return the playbook with the given values of one section replaced; None leaves a value as it is."""
    update = {name: getattr(value, "value", value) for name, value in values.items() if value is not None}
    return playbook.model_copy(update={section: getattr(playbook, section).model_copy(update=update)})
