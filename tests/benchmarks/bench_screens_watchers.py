"""Those who look at the run of `bench_screens`: screens on the bus, sockets as pages hold them, tabs of a browser.

Each is a process of its own that says when it looks, and looks until it is ended.
"""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import signal
import tempfile
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import uvicorn
import websockets
from playwright.async_api import Error as PlaywrightError

from drivers.tasks import open_background
from gcs.monitor.client import RunClient
from gcs.monitor.metrics.api import api_app
from gcs.monitor.yielding import NICENESS, give_way
from gcs.recording.bus_address import BusAddress
from tests.benchmarks.bench_links import LOOPBACK, percentile_ms
from tests.gcs.monitor.web.browsing import CHROMIUM, Browser, Dashboard, browser, opened

SWARM = "screens"
ON_THE_BUS, PAGES, TABS, TABS_GIVING_WAY = "screens on the bus", "pages", "tabs", "tabs giving way"
_TABS_OPEN_WITHIN_S = 180.0


@dataclass(frozen=True)
class Drawn:
    """What the tabs of a browser drew while they looked."""

    states_per_s: float
    """Of the tab that drew least."""
    p95_ms: float
    """From the service's sending to the screen, of all."""

    def __str__(self) -> str:
        return f"a tab drew {self.states_per_s:.1f} states/s, 95 % of them within {self.p95_ms:.0f} ms"


def find_at(endpoint: str) -> Any:
    return lambda: BusAddress(endpoint, SWARM)


async def heard(client: RunClient) -> None:
    """Return when a client has heard of the run."""
    async with asyncio.timeout(20.0):
        while client.state is None:  # noqa: ASYNC110 - a client keeps what it hears
            await asyncio.sleep(0.05)


def on_the_bus(ready: Connection, endpoint: str, count: int) -> None:
    """Follow the run as so many screens would, each with a session of its own."""

    async def follow() -> None:
        give_way()
        clients = [RunClient(find_at(endpoint)) for _ in range(count)]
        async with open_background() as start:
            for client in clients:
                start(client.follow())
            for client in clients:
                await heard(client)
            ready.send(count)
            await asyncio.Event().wait()

    asyncio.run(follow())


def page_server(ready: Connection, endpoint: str) -> None:
    """Serve pages from the bus, as the dashboard's process does."""

    async def serve_pages() -> None:
        give_way()
        client = RunClient(find_at(endpoint))
        server = uvicorn.Server(uvicorn.Config(api_app(client), port=0, log_level="error", lifespan="off"))
        async with open_background() as start:
            start(client.follow())
            await heard(client)
            start(server.serve())
            while not server.started:  # noqa: ASYNC110 - uvicorn tells it no other way
                await asyncio.sleep(0.02)
            ready.send(server.servers[0].sockets[0].getsockname()[1])
            await asyncio.Event().wait()

    asyncio.run(serve_pages())


def pages(ready: Connection, port: int, count: int) -> None:
    """Look at the run as so many browsers would; every fourth is stuck."""

    async def look(number: int) -> None:
        async with websockets.connect(f"ws://{LOOPBACK}:{port}/api/v1/live", max_queue=1) as socket:
            await socket.recv()
            looking.add(number)
            if len(looking) == count:
                all_look.set()
            if number % 4 == 0:
                await asyncio.Event().wait()
            while True:
                await socket.recv()

    looking: set[int] = set()
    all_look = asyncio.Event()

    async def look_all() -> None:
        give_way()  # they are elsewhere, in the field
        async with open_background() as start:
            for number in range(count):
                start(look(number))
            await all_look.wait()
            ready.send(count)
            await asyncio.Event().wait()

    asyncio.run(look_all())


def tabs(ready: Connection, endpoint: str, count: int, yielding: bool) -> None:
    """Look at the run with so many tabs of a real browser, each with the whole dashboard in it."""

    async def look_all() -> None:
        told = asyncio.Event()
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, told.set)
        with tempfile.TemporaryDirectory() as folder:
            site = Dashboard(folder, tokens={}, options=("--connect", endpoint, "--swarm", SWARM))
            async with site.open(), browser(no_greater(Path(folder), NICENESS if yielding else 0)) as chromium:
                open_tabs = [await opened(chromium, site.url) for _ in range(count)]
                for tab in open_tabs:
                    await tab.page.goto(site.url, timeout=1e3 * _TABS_OPEN_WITHIN_S)
                    await tab.until("fresh", "live", _TABS_OPEN_WITHIN_S)
                    await tab.forget_latencies()
                begun_s = time.monotonic()
                ready.send(count)
                await told.wait()
                looked_s = time.monotonic() - begun_s
                shown_ms = [await shown_by(tab) for tab in open_tabs]
                least = min(map(len, shown_ms)) / looked_s
                ready.send(Drawn(least, percentile_ms([1e-3 * each for tab in shown_ms for each in tab], 0.95)))

    asyncio.run(look_all())


async def shown_by(tab: Browser) -> list[float]:
    """Return how old each state was that a tab drew; nothing when it was so starved that it has loaded itself anew."""
    with contextlib.suppress(PlaywrightError):
        return list(await tab.latencies_ms())
    return []


def no_greater(folder: Path, niceness: int) -> Path:
    """Return a browser of this niceness. Where root starts it, it may not raise its priority, as nobody else's can."""
    program = folder / "chromium"
    modest = "setpriv --bounding-set=-sys_nice" if os.geteuid() == 0 else ""
    program.write_text(f'#!/bin/sh\nexec nice -n {niceness} {modest} {CHROMIUM} "$@"\n')
    program.chmod(0o755)
    return program


class Watchers:
    """The processes that look at the run."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._processes: list[Any] = []
        self._ours: list[Connection] = []

    def start(self, role: Any, *arguments: Any) -> Any:
        """Start one; return what it says when it is ready."""
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=role, args=(theirs, *arguments), daemon=True)
        process.start()
        theirs.close()
        self._processes.append(process)
        self._ours.append(ours)
        return ours.recv()

    def attach(self, mode: str, endpoint: str, count: int) -> None:
        if mode == ON_THE_BUS:
            self.start(on_the_bus, endpoint, count - 1)
            self.start(on_the_bus, endpoint, 1)
            os.kill(self._processes[-1].pid, signal.SIGSTOP)
        elif mode == PAGES:
            self.start(pages, self.start(page_server, endpoint), count)
        elif mode in (TABS, TABS_GIVING_WAY):
            self.start(tabs, endpoint, count, mode == TABS_GIVING_WAY)

    def end(self) -> Drawn | None:
        """End all; return what tabs drew, if there were any."""
        drawn = None
        for process, ours in zip(reversed(self._processes), reversed(self._ours), strict=True):
            process.terminate()
            os.kill(process.pid, signal.SIGCONT)
            process.join(60.0)
            process.kill()
            with contextlib.suppress(EOFError):
                drawn = ours.recv() if ours.poll() else drawn
        return drawn
