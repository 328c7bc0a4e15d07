"""What screens cost a flight: the jitter of its setpoints without any, and with twenty, in the same run.

    python -m tests.benchmarks.bench_screens [--vehicles N] [--seconds S] [--repeats R] [--screens N] [--ahead]

A service streams setpoints to N vehicles over real UDP on loopback, as in `bench_links`, and tells its run over a real
zenoh router: not at all; to nobody; to screens attached to the bus, one of whose processes is frozen; and to pages that
one process serves from the bus, a quarter of which never read. Two events happen a second. Screens give way to the
flight as they do when they are started, and everything shares the machine, readers of the pages and all.

Prints the share of one core that the service takes, the jitter on the wire and the time to tell one state, and exits 1
when screens or pages raise the p99 jitter by 20 % or more, medians over all repeats. Where a machine is busy with other
work that is all one sees: with `--ahead` service and vehicles go ahead of everything else (SCHED_RR, for which one has
to be root), and what is left is what screens do to the service itself.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import multiprocessing
import os
import signal
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import uvicorn
import websockets

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import encode
from drivers.clock import SystemClock
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import Link, open_link
from drivers.mavlink.link_status import LinkState, LinkStatus
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Heartbeat, Vehicle
from drivers.simulation.launcher import process_group
from drivers.tasks import open_background
from gcs.links import FleetLinks
from gcs.monitor.client import RunClient
from gcs.monitor.metrics.api import api_app
from gcs.monitor.publisher import published
from gcs.monitor.run_setup import run_setup
from gcs.monitor.sources import RunSources
from gcs.monitor.state import StateTeller
from gcs.monitor.timing import Pace
from gcs.monitor.yielding import give_way
from gcs.playbook.loader import load_playbook
from gcs.recording.bus_address import BusAddress
from gcs.relay.records import LegRecord, ReceiverRecord
from gcs.relay.states import ReceiverState
from gcs.run_bus import joined, start_router
from gcs.safety import SitePosition
from gcs.status import RunStatus
from gcs.stop_monitor import LegEstimate
from planner.frames import SiteFrame
from tests.benchmarks.bench_links import (
    LOOPBACK,
    RATE_HZ,
    Station,
    Usage,
    Window,
    Wire,
    fly,
    percentile_ms,
    play_vehicles,
)

LARGEST_RISE = 1.20
EVENT_S = 0.5
WARM_UP_S = 7.0
"""Until every process has started, on a machine that is busy with all of them."""
SWARM = "screens"
MODES = ("not told", "told to nobody", "screens on the bus", "pages")


@dataclass(frozen=True)
class Options:
    mode: str
    vehicles: int
    endpoint: str
    ahead: bool


def go_ahead(ahead: bool) -> None:
    """Let this process go ahead of all that are not told so."""
    if ahead:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


def vehicles_ahead(results: Connection, ports: list[int], window: Window, ahead: bool) -> None:
    go_ahead(ahead)
    play_vehicles(results, ports, signed=False, window=window)


# --- the process under test


def service(orchestrator: Connection, options: Options) -> None:
    go_ahead(options.ahead)
    asyncio.run(serve(orchestrator, options))


async def serve(orchestrator: Connection, options: Options) -> None:
    clock = SystemClock()
    async with contextlib.AsyncExitStack() as stack:
        links: list[Link] = []
        for _ in range(options.vehicles):
            address = LinkAddress("udpin", LOOPBACK, 0)
            links.append(await stack.enter_async_context(open_link(address, Codec(), clock, None)))
        vehicles = {f"V{k}": Vehicle(f"V{k}", k, link, clock) for k, link in enumerate(links, start=1)}
        bus = await stack.enter_async_context(joined(options.endpoint))
        sources = run_of(vehicles, links, clock)
        start = await stack.enter_async_context(open_background())
        if options.mode != "not told":
            await stack.enter_async_context(published(bus, SwarmKeys(SWARM), sources))
        start(happen(sources.status))
        orchestrator.send([link.address.port for link in links])
        window: Window = await asyncio.to_thread(orchestrator.recv)
        async with asyncio.TaskGroup() as group:
            flights = [group.create_task(fly(vehicle, clock)) for vehicle in vehicles.values()]
            await clock.sleep(window.begin_s - time.monotonic())
            usage, before = Usage(window), sum(link.counters.received for link in links)
            await clock.sleep(window.end_s - time.monotonic())
            orchestrator.send(usage.station(sum(link.counters.received for link in links) - before))
            for flight in flights:
                flight.cancel()


def run_of(vehicles: dict[str, Vehicle], links: list[Link], clock: SystemClock) -> RunSources:
    """Return a run in which one receiver of twenty is on its leg, and every vehicle speaks."""
    playbook = load_playbook(Path("sitl_configs/paper_20.yaml"))
    plan = playbook.plan()
    status = RunStatus(SWARM, clock, phase="relay")
    records = {route.receiver: ReceiverRecord(route) for route in plan.routes}
    flying = next(iter(records.values()))
    flying.state = ReceiverState.LEG_1
    flying.legs.append(LegRecord(flying.route.legs[0], 0.0, estimate=LegEstimate(20.0, 0.1, 4.0, 0.2)))
    flying.legs[-1].measured_angle_rad = 1.0
    status.records = records
    fleet = FleetLinks(vehicles, {link: [name] for link, name in zip(links, vehicles, strict=False)})
    status.links = lambda: fleet.statuses(clock.now_s())
    setup = run_setup(playbook, plan, run="bench", started_ns=clock.unix_ns())
    pace = Pace(playbook.flight.speed_mps)
    sources = RunSources(setup, status, playbook.site.frame, pace, vehicles=vehicles)
    site = SiteFrame(playbook.site.origin)
    for name, vehicle in vehicles.items():
        vehicle.on_kinematics.append(
            lambda kinematics, name=name: sources.board.latest.__setitem__(
                name, SitePosition(kinematics.time_s, site.from_geodetic(kinematics.position)[0], 20.0)
            )
        )
    return sources


async def happen(status: RunStatus) -> None:
    while True:
        await status.clock.sleep(EVENT_S)
        status.say("U1 LEG_1: something happened", vehicle="U1", leg=1, state="LEG_1")


# --- the screens


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


class Watchers:
    """The processes that look at the run."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._processes: list[Any] = []

    def start(self, role: Any, *arguments: Any) -> Any:
        """Start one; return what it says when it is ready."""
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=role, args=(theirs, *arguments), daemon=True)
        process.start()
        self._processes.append(process)
        return ours.recv()

    def attach(self, mode: str, endpoint: str, count: int) -> None:
        if mode == "screens on the bus":
            self.start(on_the_bus, endpoint, count - 1)
            self.start(on_the_bus, endpoint, 1)
            os.kill(self._processes[-1].pid, signal.SIGSTOP)
        elif mode == "pages":
            self.start(pages, self.start(page_server, endpoint), count)

    def end(self) -> None:
        for process in reversed(self._processes):
            process.kill()
            process.join(5.0)


# --- one run of each, side by side


def measure(options: Options, seconds: float, screens: int) -> tuple[Station, Wire]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    station = context.Process(target=service, args=(theirs, options))
    station.start()
    ports = ours.recv()
    watchers = Watchers()
    try:
        watchers.attach(options.mode, options.endpoint, screens)
        begin_s = time.monotonic() + WARM_UP_S
        window = Window(begin_s, begin_s + seconds)
        results, writing = context.Pipe(duplex=False)
        vehicles = context.Process(target=vehicles_ahead, args=(writing, ports, window, options.ahead))
        vehicles.start()
        ours.send(window)
        used: Station = ours.recv()
        wire, _ = results.recv()
        vehicles.join(10.0)
    finally:
        watchers.end()
        station.join(10.0)
        station.kill()
    return used, wire


async def all_modes(arguments: argparse.Namespace) -> dict[str, list[float]]:
    p99_ms: dict[str, list[float]] = {mode: [] for mode in MODES}
    print(f"{arguments.vehicles} vehicles at {RATE_HZ} Hz, {arguments.screens} screens, {arguments.seconds:g} s each")
    print(f"{'':20}{'core':>7}{'jitter p50':>12}{'p99 ms':>8}{'p99.9':>8}{'waited':>9}{'setpoints/s':>13}{'lost':>8}")
    with tempfile.TemporaryDirectory() as folder:
        async with process_group(Path(folder)) as group:
            endpoint = await start_router(group)
            async with joined(endpoint):
                for _ in range(arguments.repeats):
                    for mode in MODES:
                        options = Options(mode, arguments.vehicles, endpoint, arguments.ahead)
                        used, wire = await asyncio.to_thread(measure, options, arguments.seconds, arguments.screens)
                        jitter_s = [abs(interval_s - 1.0 / RATE_HZ) for interval_s in wire.intervals_s]
                        p50_ms, tail_ms = percentile_ms(jitter_s, 0.50), percentile_ms(jitter_s, 0.99)
                        extreme_ms = percentile_ms(jitter_s, 0.999)
                        p99_ms[mode].append(tail_ms)
                        print(
                            f"{mode:20}{used.core:7.1%}{p50_ms:12.2f}{tail_ms:8.2f}{extreme_ms:8.2f}{used.waited:9.1%}"
                            f"{wire.sent / arguments.seconds:13.1f}"
                            f"{wire.lost / (wire.lost + len(wire.intervals_s)):8.2%}",
                            flush=True,
                        )
    return p99_ms


class Silence:
    """A link on which nothing is said."""

    address = LinkAddress("udpin", LOOPBACK, 0)

    def listen(self, _subscription: object) -> None:
        """Hand over nothing."""


def telling_ms(vehicles: int) -> tuple[float, int]:
    """Return how long one state takes to be told and encoded, ms, and its size, bytes."""
    clock = SystemClock()
    made = {f"V{number}": Vehicle(f"V{number}", number, Silence(), clock) for number in range(vehicles)}
    sources = run_of(made, [], clock)
    for number, (name, vehicle) in enumerate(made.items()):
        vehicle.telemetry.heartbeat = Heartbeat(clock.now_s(), 2, 3, 4, armed=True, system_status=4)
        vehicle.telemetry.last_message_s = clock.now_s()
        sources.board.latest[name] = SitePosition(0.0, complex(10.0 * number), 20.0)
    link = LinkStatus("udpin:127.0.0.1:14550", LinkState.UP, 1000, 1000, 0, 0, 0, 0, 0.0, 0.1, (1,), ())
    sources.status.links = lambda: [(name, link) for name in made]
    teller, costs_s, size = StateTeller(sources), list[float](), 0
    for _ in range(2000):
        begun_s = time.thread_time()
        size = len(encode(teller.tell()))
        costs_s.append(time.thread_time() - begun_s)
    return 1e3 * statistics.median(costs_s), size


def main(arguments: argparse.Namespace) -> int:
    cost_ms, size = telling_ms(arguments.vehicles)
    print(f"one state: {cost_ms:.2f} ms to tell and encode, {size} bytes; at 5 Hz {0.5 * cost_ms:.2f} % of a core")
    p99_ms = asyncio.run(all_modes(arguments))
    medians_ms = {mode: statistics.median(values) for mode, values in p99_ms.items()}
    met = True
    for mode in MODES[1:]:
        rise = medians_ms[mode] / medians_ms["not told"]
        met = met and rise < LARGEST_RISE
        print(f"{mode:20} p99 jitter {medians_ms[mode]:.2f} ms, {rise:.2f} times that of a run that is not told")
    print(f"screens raise the p99 jitter by less than {LARGEST_RISE - 1.0:.0%}: {'yes' if met else 'NO'}")
    return 0 if met else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--screens", type=int, default=20)
    parser.add_argument("--ahead", action="store_true", help="service and vehicles go ahead of everything else")
    sys.exit(main(parser.parse_args()))
