"""`sensor`: one AOA sensor on the companion computer of its UAV."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from ruamel.yaml import YAML

from drivers.aoa.host import SensorHost
from drivers.aoa.kinds import SENSORS, read_settings
from drivers.aoa.sensor import Say, Sensor
from drivers.bus.keys import NAME_PATTERN, SwarmKeys
from drivers.bus.messages import json_schemas
from drivers.bus.security import with_keys
from drivers.bus.session import BusEndpoint, require_closed
from drivers.clock import SystemClock
from drivers.process import until_told_to_stop
from gcs.commands.options import BusKeys, InsecureBus
from gcs.errors import ServiceError
from gcs.run_bus import joined_aloud

_LARGEST_SETTINGS_BYTES: Final = 100_000
_ENDPOINT: Final = re.compile(r"(tcp|tls|quic|udp)/.+:\d+")

SensorKind = Enum("SensorKind", {name: name for name in SENSORS}, type=str)  # type: ignore[misc]


def sensor(
    kind: Annotated[SensorKind | None, typer.Argument(help="what it is")] = None,
    swarm: Annotated[str, typer.Option(help="the swarm: the playbook's name")] = "",
    uav: Annotated[str, typer.Option(help="the UAV it is on, as the playbook calls it")] = "",
    connect: Annotated[str, typer.Option(help="the bus router, e.g. tcp/10.0.0.1:7447")] = "",
    settings: Annotated[Path | None, typer.Option(help="what the sensor has to be told, a YAML file")] = None,
    keys: BusKeys = None,
    insecure: InsecureBus = False,
    schema: Annotated[bool, typer.Option("--schema", help="print the JSON Schema of what is on the bus")] = False,
) -> None:
    """Run an AOA sensor on a UAV's companion computer, until told to stop. The bus may come and go."""
    if schema:
        typer.echo(json.dumps(json_schemas(), indent=2))
        return
    _require(kind is not None, f"which sensor? Known are {', '.join(SENSORS)}")
    _require(re.fullmatch(NAME_PATTERN, swarm), "--swarm takes the playbook's name")
    _require(re.fullmatch(NAME_PATTERN, uav), "--uav takes the UAV's name in the playbook")
    _require(_ENDPOINT.fullmatch(connect), "--connect takes the bus router, e.g. tcp/10.0.0.1:7447")
    clock, endpoint = SystemClock(), with_keys(BusEndpoint(connect, insecure=insecure), keys)
    require_closed(endpoint)
    made = read_settings(kind.value if kind is not None else "", _read(settings)).open(clock)
    console = Console(stderr=True)

    def say(message: str) -> None:
        console.print(message, markup=False, highlight=False, soft_wrap=True)

    asyncio.run(_run(made, uav, SwarmKeys(swarm), endpoint, clock, say))


async def _run(made: Sensor, uav: str, keys: SwarmKeys, endpoint: BusEndpoint, clock: SystemClock, say: Say) -> None:
    """Run the sensor until it ends or this process is told to stop."""
    told = asyncio.ensure_future(until_told_to_stop())
    work = asyncio.ensure_future(_work(made, uav, keys, endpoint, clock, say))
    try:
        await asyncio.wait((told, work), return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (told, work):
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await work


async def _work(made: Sensor, uav: str, keys: SwarmKeys, endpoint: BusEndpoint, clock: SystemClock, say: Say) -> None:
    async with joined_aloud(endpoint, say) as bus:
        say(f"{uav}: on the bus of swarm {keys.swarm} at {endpoint.endpoint}")
        await SensorHost(made, uav, keys, bus, clock).run(say)


def _read(path: Path | None) -> Any:
    """Return what a YAML file holds; nothing without a file. ServiceError when it cannot be read."""
    if path is None:
        return {}
    try:
        with path.open("rb") as file:
            text = file.read(_LARGEST_SETTINGS_BYTES + 1)
        if len(text) > _LARGEST_SETTINGS_BYTES:
            raise ValueError("it is too large for the settings of a sensor")
        values = YAML(typ="safe", pure=True).load(text.decode("utf-8"))
    except Exception as error:  # a file made to do harm makes its reader raise anything
        raise ServiceError(f"{path} cannot be read: {error}") from error
    return {} if values is None else values


def _require(given: object, message: str) -> None:
    if not given:
        raise ServiceError(message)
