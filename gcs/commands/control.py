"""`control`: the operator's word to a relay that is being flown."""

from __future__ import annotations

import asyncio
import re
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from drivers.bus.keys import NAME_PATTERN, SwarmKeys
from drivers.bus.messages import ControlReply, ControlRequest, MalformedMessageError, decode
from drivers.bus.security import with_keys
from drivers.bus.session import BusEndpoint, open_bus
from drivers.errors import BusError
from gcs.commands.options import BusKeys, InsecureBus, RunsDir
from gcs.control import VERBS
from gcs.errors import ServiceError
from gcs.monitor.access import COMMAND_VARIABLE, read_tokens
from gcs.monitor.proven import Words, proving
from gcs.recording.bus_address import BusAddress, address_of, newest_run

Verb = Enum("Verb", {verb: verb for verb in VERBS}, type=str)  # type: ignore[misc]


def control(
    verb: Annotated[
        Verb,
        typer.Argument(
            help="hold: stop all; resume: go on, located anew; release VEHICLE: take it back from its pilot; "
            "skip VEHICLE: give it up; takeover NODE: give on what a lost link node had; "
            "abort: stop all and end the run"
        ),
    ],
    vehicle: Annotated[
        str | None, typer.Argument(help="whom to release, skip or take over from", metavar="[VEHICLE]")
    ] = None,
    connect: Annotated[str | None, typer.Option(help="the bus router of the run, tcp/HOST:PORT")] = None,
    swarm: Annotated[str | None, typer.Option(help="the swarm: the playbook's name")] = None,
    run: Annotated[Path | None, typer.Option(help="the folder of the run; without it the newest run")] = None,
    runs_dir: RunsDir = Path("runs"),
    keys: BusKeys = None,
    insecure: InsecureBus = False,
    command_token_file: Annotated[
        Path | None,
        typer.Option(help=f"the token, where the run takes words only from its holders; else {COMMAND_VARIABLE}"),
    ] = None,
) -> None:
    """Have a word with a relay that is being flown. Exit status 0: done, 1: refused, 2: not reached."""
    if connect is not None and swarm is not None:
        address = BusAddress(connect, swarm, insecure)
    else:
        found = address_of(run or newest_run(runs_dir))
        meant = insecure or (found.insecure and connect is None)
        address = BusAddress(connect or found.endpoint, swarm or found.swarm, meant)
    if re.fullmatch(NAME_PATTERN, address.swarm) is None:
        raise ServiceError(f"{address.swarm!r} is no name of a swarm: --swarm takes the playbook's name")
    reply = asyncio.run(
        _ask(address, keys, ControlRequest(verb.value, vehicle), proving(read_tokens(None, command_token_file).command))
    )
    console = Console(soft_wrap=True, highlight=False, markup=False)
    console.print(reply.message, style=None if reply.ok else "red")
    if not reply.ok:
        raise typer.Exit(1)


async def _ask(address: BusAddress, keys: Path | None, request: ControlRequest, say: Words) -> ControlReply:
    key = SwarmKeys(address.swarm).control
    async with open_bus(with_keys(BusEndpoint(address.endpoint, insecure=address.insecure), keys)) as bus:
        payload = await bus.ask(key, say(address.swarm, request))
    try:
        return decode(payload, ControlReply)
    except MalformedMessageError as error:
        raise BusError(f"{key} is answered by something else than this service: {error}") from error
