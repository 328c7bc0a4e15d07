"""The bus of a run: the playbook's own router, or one started for it on loopback."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

from drivers.bus.security import with_keys
from drivers.bus.session import BusEndpoint, LiveBus, open_bus, require_closed
from drivers.errors import BusError
from drivers.simulation.launcher import ProcessGroup, free_tcp_port, this_pid

START_TIMEOUT_S: Final = 10.0


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
    while True:
        try:
            async with open_bus(way_in) as bus:
                yield bus
                return
        except BusError:
            if time.monotonic() > deadline_s:
                raise
            await asyncio.sleep(0.1)
