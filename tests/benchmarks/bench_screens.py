"""What screens cost a flight: the jitter of its setpoints without any, and with twenty, in the same run.

    python -m tests.benchmarks.bench_screens [--vehicles N] [--seconds S] [--repeats R] [--screens N] [--tabs] [--ahead]

A service streams setpoints to N vehicles over real UDP on loopback, as in `bench_links`, and tells its run over a real
zenoh router: not at all; to nobody; to screens attached to the bus, one of whose processes is frozen; and to pages that
one process serves from the bus, a quarter of which never read. Two events happen a second. Screens give way to the
flight as they do when they are started, and everything shares the machine, readers of the pages and all.

With `--tabs` the dashboard is opened in as many tabs of one real browser, too: as equal to the flight as any program
on this machine, and giving way to it. In the field browsers are on other machines: what their drawing takes of these
cores is no cost of the service, and only those that give way are judged.

Prints the share of one core that the service takes, the jitter on the wire and the time to tell one state, and exits 1
when those who are judged raise the p99 jitter by 20 % or more, medians over all repeats. Where a machine is busy with
other work that is all one sees: with `--ahead` service and vehicles go ahead of everything else (SCHED_RR, for which
one has to be root), and what is left is what screens do to the service itself.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import multiprocessing
import os
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

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
from gcs.monitor.publisher import published
from gcs.monitor.run_setup import run_setup
from gcs.monitor.sources import RunSources
from gcs.monitor.state import StateTeller
from gcs.monitor.timing import Pace
from gcs.playbook.loader import load_playbook
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
from tests.benchmarks.bench_screens_watchers import (
    ON_THE_BUS,
    PAGES,
    SWARM,
    TABS,
    TABS_GIVING_WAY,
    Drawn,
    Watchers,
)

LARGEST_RISE = 1.20
EVENT_S = 0.5
WARM_UP_S, LONG_WARM_UP_S = 7.0, 30.0
"""Until every process has started, on a machine that is busy with all of them; beside a browser that draws."""
NOT_TOLD, TO_NOBODY = "not told", "told to nobody"
MODES = (NOT_TOLD, TO_NOBODY, ON_THE_BUS, PAGES)
BROWSERS = (TABS, TABS_GIVING_WAY)


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
        if options.mode != NOT_TOLD:
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


# --- one run of each, side by side


def measure(options: Options, seconds: float, screens: int) -> tuple[Station, Wire, Drawn | None]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    station = context.Process(target=service, args=(theirs, options))
    station.start()
    ports = ours.recv()
    watchers = Watchers()
    try:
        watchers.attach(options.mode, options.endpoint, screens)
        begin_s = time.monotonic() + (LONG_WARM_UP_S if options.mode in BROWSERS else WARM_UP_S)
        window = Window(begin_s, begin_s + seconds)
        results, writing = context.Pipe(duplex=False)
        vehicles = context.Process(target=vehicles_ahead, args=(writing, ports, window, options.ahead))
        vehicles.start()
        ours.send(window)
        used: Station = ours.recv()
        wire, _ = results.recv()
        vehicles.join(10.0)
    finally:
        drawn = watchers.end()
        station.join(10.0)
        station.kill()
    return used, wire, drawn


async def all_modes(arguments: argparse.Namespace) -> dict[str, list[float]]:
    p99_ms: dict[str, list[float]] = {mode: [] for mode in (*MODES, *(BROWSERS if arguments.tabs else ()))}
    print(f"{arguments.vehicles} vehicles at {RATE_HZ} Hz, {arguments.screens} screens, {arguments.seconds:g} s each")
    print(f"{'':20}{'core':>7}{'jitter p50':>12}{'p99 ms':>8}{'p99.9':>8}{'waited':>9}{'setpoints/s':>13}{'lost':>8}")
    with tempfile.TemporaryDirectory() as folder:
        async with process_group(Path(folder)) as group:
            endpoint = await start_router(group)
            async with joined(endpoint):
                for _ in range(arguments.repeats):
                    for mode, tails_ms in p99_ms.items():
                        options = Options(mode, arguments.vehicles, endpoint, arguments.ahead)
                        used, wire, drawn = await asyncio.to_thread(
                            measure, options, arguments.seconds, arguments.screens
                        )
                        jitter_s = [abs(interval_s - 1.0 / RATE_HZ) for interval_s in wire.intervals_s]
                        p50_ms, tail_ms = percentile_ms(jitter_s, 0.50), percentile_ms(jitter_s, 0.99)
                        extreme_ms = percentile_ms(jitter_s, 0.999)
                        tails_ms.append(tail_ms)
                        print(
                            f"{mode:20}{used.core:7.1%}{p50_ms:12.2f}{tail_ms:8.2f}{extreme_ms:8.2f}{used.waited:9.1%}"
                            f"{wire.sent / arguments.seconds:13.1f}"
                            f"{wire.lost / (wire.lost + len(wire.intervals_s)):8.2%}",
                            flush=True,
                        )
                        if drawn is not None:
                            print(f"  {drawn}")
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
    for mode in [mode for mode in medians_ms if mode != NOT_TOLD]:
        rise = medians_ms[mode] / medians_ms[NOT_TOLD]
        met = met and (rise < LARGEST_RISE or mode == TABS)
        print(f"{mode:20} p99 jitter {medians_ms[mode]:.2f} ms, {rise:.2f} times that of a run that is not told")
    print(f"screens raise the p99 jitter by less than {LARGEST_RISE - 1.0:.0%}: {'yes' if met else 'NO'}")
    return 0 if met else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--screens", type=int, default=20)
    parser.add_argument("--tabs", action="store_true", help="the dashboard in as many tabs of a browser, too")
    parser.add_argument("--ahead", action="store_true", help="service and vehicles go ahead of everything else")
    sys.exit(main(parser.parse_args()))
