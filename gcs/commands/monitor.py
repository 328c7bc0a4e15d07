"""`monitor`: a run on the terminal, from any machine that reaches its bus."""

from __future__ import annotations

import asyncio
import re
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from drivers.bus.keys import NAME_PATTERN
from drivers.bus.session import BusEndpoint, require_closed
from gcs.commands.options import BusKeys, InsecureBus, RunsDir
from gcs.errors import ServiceError
from gcs.monitor.access import read_tokens
from gcs.monitor.client import RunClient, joining
from gcs.monitor.proven import proving
from gcs.monitor.yielding import give_way
from gcs.recording.bus_address import BusAddress, address_of, newest_run


def monitor(
    connect: Annotated[
        str | None, typer.Option(help="the bus router of the run, tcp/HOST:PORT; without it that of --run")
    ] = None,
    swarm: Annotated[
        str | None, typer.Option(help="the swarm: the playbook's name; without it the only one on the bus")
    ] = None,
    run: Annotated[Path | None, typer.Option(help="the folder of the run; without it the newest run")] = None,
    runs_dir: RunsDir = Path("runs"),
    keys: BusKeys = None,
    insecure: InsecureBus = False,
    command_token_file: Annotated[
        Path | None,
        typer.Option(help="the token for commanding; without it, and without BEARING_RELAY_COMMAND_TOKEN, read-only"),
    ] = None,
) -> None:
    """Watch a run on the terminal. Several may, from anywhere; it finds the run again whenever it was lost."""
    if find_spec("textual") is None:
        raise ServiceError("the terminal monitor needs Textual: pip install 'bearing-relay[monitor]'")
    from gcs.monitor.terminal_app.app import show  # noqa: PLC0415 - it is an extra

    if swarm is not None and re.fullmatch(NAME_PATTERN, swarm) is None:
        raise ServiceError(f"{swarm!r} is no name of a swarm: --swarm takes the playbook's name")

    def find() -> BusAddress:
        if connect is not None:
            return BusAddress(connect, swarm or "", insecure)
        found = address_of(run or newest_run(runs_dir))
        return BusAddress(found.endpoint, swarm or found.swarm, insecure or found.insecure)

    if connect is not None and keys is None:
        require_closed(BusEndpoint(connect, insecure=insecure))
    give_way()
    token = read_tokens(None, command_token_file).command
    client = RunClient(find, open_bus=joining(keys), say=proving(token))
    asyncio.run(show(client, commands=token is not None))
