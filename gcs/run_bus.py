"""The bus of a run: the playbook's own router, or one started for it on loopback."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Final

from drivers.bus.security import with_keys
from drivers.bus.session import BusEndpoint, LiveBus, open_bus, require_closed
from drivers.errors import BusError
from drivers.simulation.launcher import ProcessGroup, free_tcp_port, this_pid

START_TIMEOUT_S: Final = 10.0
RETRY_S: Final = 2.0


async def start_router(group: ProcessGroup) -> str:
    """Start a bus router on loopback and return its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    await group.start("bus-router", ["-m", "drivers.bus.router", endpoint, "--parent-pid", str(this_pid())])
    return endpoint


@contextlib.asynccontextmanager
async def joined(endpoint: str, keys: str | None = None, *, insecure: bool = False) -> AsyncIterator[LiveBus]:
    """Join the bus, with the service's keys where it is closed, waiting for a router that is just starting."""
    way_in = with_keys(BusEndpoint(endpoint, insecure=insecure), Path(keys) if keys else None)
    require_closed(way_in)
    deadline_s = time.monotonic() + START_TIMEOUT_S

    def failed(error: BusError) -> None:
        if time.monotonic() > deadline_s:
            raise error

    async with _joined_in_time(way_in, 0.1, failed) as bus:
        yield bus


@contextlib.asynccontextmanager
async def joined_aloud(way_in: BusEndpoint, say: Callable[[str], None]) -> AsyncIterator[LiveBus]:
    """Join the bus, waiting for a router for as long as there is none, which is said once."""
    said: list[BusError] = []

    def failed(error: BusError) -> None:
        if not said:
            say(f"{error} Trying again every {RETRY_S:g} s.")
        said.append(error)

    async with _joined_in_time(way_in, RETRY_S, failed) as bus:
        yield bus


@contextlib.asynccontextmanager
async def _joined_in_time(
    way_in: BusEndpoint, retry_s: float, failed: Callable[[BusError], None]
) -> AsyncIterator[LiveBus]:
    """Join the bus as soon as it can be joined; `failed` is told of each attempt, and ends them by raising."""
    async with contextlib.AsyncExitStack() as stack:
        while True:
            try:
                bus = await stack.enter_async_context(open_bus(way_in))
                break
            except BusError as error:
                failed(error)
            await asyncio.sleep(retry_s)
        yield bus
