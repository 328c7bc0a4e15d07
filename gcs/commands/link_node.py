"""`link-node`: a share of a swarm's vehicles flown from where their links are."""

from __future__ import annotations

import asyncio
import contextlib
import re
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console

from drivers.bus.keys import NAME_PATTERN
from drivers.bus.security import with_keys
from drivers.bus.session import BusEndpoint, require_closed
from drivers.clock import SystemClock
from drivers.mavlink.tlog import open_tlogs
from drivers.process import until_told_to_stop
from gcs.commands.options import BusKeys, InsecureBus
from gcs.errors import ServiceError
from gcs.nodes.link_node import LinkNode, NoLogs, Say
from gcs.run_bus import joined_aloud
from gcs.takeovers import FrameLogs

_ENDPOINT: Final = re.compile(r"(tcp|tls|quic|udp)/.+:\d+")


def link_node(
    name: Annotated[str, typer.Argument(help="the node, as the playbook calls it")],
    swarm: Annotated[str, typer.Option(help="the swarm: the playbook's name")],
    connect: Annotated[str, typer.Option(help="the bus router near it, e.g. tcp/10.0.0.1:7447")],
    logs: Annotated[
        Path | None, typer.Option(help="a folder for the .tlog of every link; without it none is kept")
    ] = None,
    keys: BusKeys = None,
    insecure: InsecureBus = False,
) -> None:
    """Hold vehicles for the service of a swarm, and fly their legs from here, until told to stop.

    Cut off from the service, it stops them within about a second, and lets them go. The bus may come and go.
    """
    for what, given in (("NAME", name), ("--swarm", swarm)):
        if re.fullmatch(NAME_PATTERN, given) is None:
            raise ServiceError(f"{given!r} is no name: {what} takes letters, digits, '_', '.' and '-'")
    if _ENDPOINT.fullmatch(connect) is None:
        raise ServiceError("--connect takes the bus router, e.g. tcp/10.0.0.1:7447")
    endpoint = with_keys(BusEndpoint(connect, insecure=insecure), keys)
    require_closed(endpoint)
    console = Console(stderr=True)

    def say(message: str) -> None:
        stamp = time.strftime("%H:%M:%S")
        console.print(f"{stamp} {message}", markup=False, highlight=False, soft_wrap=True)

    if logs is not None:
        _make(logs)
    asyncio.run(_run(name, swarm, endpoint, logs, say))


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ServiceError(f"--logs {folder} cannot be made: {error.strerror}") from error


async def _run(name: str, swarm: str, endpoint: BusEndpoint, logs: Path | None, say: Say) -> None:
    """Run the node until this process is told to stop."""
    told = asyncio.ensure_future(until_told_to_stop())
    work = asyncio.ensure_future(_work(name, swarm, endpoint, logs, say))
    try:
        await asyncio.wait((told, work), return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (told, work):
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await work


async def _work(name: str, swarm: str, endpoint: BusEndpoint, logs: Path | None, say: Say) -> None:
    clock = SystemClock()
    async with joined_aloud(endpoint, say) as bus, _logged(logs, clock) as kept:
        say(f"node {name}: on the bus of swarm {swarm} at {endpoint.endpoint}")
        await LinkNode(name, swarm, bus, clock, say, kept).run()


@contextlib.asynccontextmanager
async def _logged(folder: Path | None, clock: SystemClock) -> AsyncIterator[FrameLogs]:
    if folder is None:
        yield NoLogs()
        return
    async with open_tlogs(folder, clock) as tlogs:
        yield tlogs
