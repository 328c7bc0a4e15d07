"""Stop latency: from the bearing report that ends a leg, put on the bus, to zero velocity on the wire.

    python -m tests.benchmarks.bench_stop [--vehicles N] [--seconds S] [--rounds R] [--recorded] [--closed] [--ahead]

A swarm reports bearings and positions 10 times a second through a bus router of its own process. One service process
flies all of it to and fro, on short legs, with what flies a relay: feed, stop monitors, leg flights, leased streams,
link, and with `--recorded` the recording too. It tells which report ended each leg; the zero velocity that follows is
timed by the receiving kernel. Beside it, at the same time and with the same payloads, a tenth of the reports are
answered by a bare zenoh subscriber behind the same router, and by a bare UDP socket. With `--closed` the bus is closed
to strangers, and its router counts whom it refuses.

Prints every round, with the machine's load, and exits 1 unless every stop has come and the median over the rounds of
the p99 is below 20 ms. On a machine that is busy with other work that work is what one sees: with `--ahead` all of this
goes ahead of everything else (SCHED_RR, for which one has to be root).
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import select
import socket
import statistics
import struct
import sys
import time
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import zenoh

from drivers.bus.messages import BearingReport, encode
from drivers.bus.security import with_keys
from drivers.bus.session import BusEndpoint
from drivers.mavlink.setpoints import StreamLimits
from tests.benchmarks.answering import (
    answer_from_udp,
    answer_from_zenoh,
    closed_router,
    cpu_s,
    open_station,
    process,
    router,
    to_port,
    until_terminated,
)
from tests.benchmarks.swarm import (
    KEYS,
    Arrival,
    Swarm,
    arrival_at,
    bearing_publisher,
    timed_socket,
)
from tests.benchmarks.to_and_fro import SETTLING_S, recording_of, to_and_fro

LARGEST_P99_MS = 20.0
EVERY = 10
"""One in so many vehicles' reports are answered by the transports alone, too."""
_STOP = struct.Struct("!4sBQ")
_LONGEST_STOP_NS = 2_000_000_000


# The service


async def serve(endpoint: str, port: int, count: int, *, recorded: bool, keys: Path | None) -> None:
    """Fly every vehicle to and fro until told to end; tell the probe of every leg that has ended."""
    async with (
        open_station(endpoint, to_port(port), count, StreamLimits(), keys) as station,
        recording_of(station, recorded=recorded) as trace,
    ):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as telling:
            telling.connect(("127.0.0.1", port))

            def tell(number: int, captured_ns: int) -> None:
                telling.send(_STOP.pack(b"stop", number, captured_ns))

            for number in range(1, count + 1):
                station.start(to_and_fro(station, number, count, trace, tell))
            await until_terminated()


# The probe


@dataclass
class Floor:
    """A bare transport that answers some of the reports."""

    port_in: socket.socket
    answering: tuple[str, int] = ("", 0)
    latencies_ms: list[float] = field(default_factory=list)
    asked: int = 0
    _asked_ns: dict[int, int] = field(default_factory=dict)

    def meet(self) -> None:
        """Wait for it."""
        _, self.answering = arrival_at(self.port_in)

    def ask(self, number: int) -> None:
        """Note that a report of one vehicle goes out now."""
        self.asked += 1
        self._asked_ns[number] = time.time_ns()

    def drain(self) -> None:
        """Take the answers that have come."""
        while select.select([self.port_in], [], [], 0.0)[0]:
            arrival, _ = arrival_at(self.port_in)
            asked_ns = None if arrival.number is None else self._asked_ns.pop(arrival.number, None)
            if asked_ns is not None:
                self.latencies_ms.append((arrival.time_ns - asked_ns) * 1e-6)

    def clear(self) -> None:
        """Begin to count."""
        self.latencies_ms.clear()
        self._asked_ns.clear()
        self.asked = 0


@dataclass
class Stops:
    """What was put on the bus, what came on the wire, and which reports the service says ended a leg."""

    put: defaultdict[int, list[tuple[int, int]]] = field(default_factory=lambda: defaultdict(list))
    """When each report was captured, and put on the bus, ns."""
    zeros_ns: defaultdict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    told: list[tuple[int, int]] = field(default_factory=list)

    def take(self, arrival: Arrival) -> None:
        """Note a datagram."""
        if arrival.datagram.startswith(b"stop"):
            _, number, captured_ns = _STOP.unpack(arrival.datagram)
            self.told.append((number, captured_ns))
        elif arrival.number is not None and arrival.velocity == 0j:
            self.zeros_ns[arrival.number].append(arrival.time_ns)

    def latencies_ms(self, began_ns: int) -> Iterator[float | None]:
        """Yield how long every stop since a time took; None for one that never came."""
        for number, captured_ns in self.told:
            at, put_ns = min(self.put[number], key=lambda report: abs(report[0] - captured_ns))
            if put_ns < began_ns:
                continue
            assert abs(at - captured_ns) < 20_000_000, "no report was captured then"
            zeros_ns = self.zeros_ns[number]
            first = bisect_left(zeros_ns, put_ns)
            late = first == len(zeros_ns) or zeros_ns[first] > put_ns + _LONGEST_STOP_NS
            yield None if late else (zeros_ns[first] - put_ns) * 1e-6


@dataclass(frozen=True)
class Round:
    """The latencies of one round, ms, and how much of a core the service and the router took."""

    stops: list[float]
    unseen: int
    zenoh: Floor
    udp: Floor
    service_core: float
    router_core: float
    load: float


def measure(endpoint: str, router_pid: int, keys: Path | None, options: argparse.Namespace) -> Round:
    """Fly one round."""
    with (
        zenoh.open(with_keys(BusEndpoint(endpoint), keys).configuration()) as session,
        timed_socket() as port_in,
        timed_socket() as zenoh_in,
        timed_socket() as udp_in,
    ):
        stops, bare_zenoh, bare_udp = Stops(), Floor(zenoh_in), Floor(udp_in)
        swarm = Swarm(options.vehicles, port_in, stops.take, positions=True)
        publishers = {number: bearing_publisher(session, number) for number in swarm.places}
        also = [number for number in swarm.places if number % EVERY == 0]

        def put(number: int, report: BearingReport) -> None:
            payload = encode(report)
            if number % EVERY == 0:
                bare_udp.drain()
                bare_zenoh.drain()
                bare_udp.ask(number)
                udp_in.sendto(bytes([number]) + payload, bare_udp.answering)
                bare_zenoh.ask(number)
            stops.put[number].append((report.captured_ns, time.time_ns()))
            publishers[number].put(payload)

        this, ports = ("-m", "tests.benchmarks.bench_stop"), [port_in, zenoh_in, udp_in]
        to, to_zenoh, to_udp = (str(opened.getsockname()[1]) for opened in ports)
        flags = (["--recorded"] if options.recorded else []) + (["--keys", str(keys)] if keys else [])
        with (
            process(*this, "--role", "udp", to_udp),
            process(*this, *flags, "--role", "zenoh", to_zenoh, endpoint, *map(KEYS.bearings, (f"U{n}" for n in also))),
            process(*this, *flags, "--role", "service", to, endpoint, str(options.vehicles)) as service,
        ):
            bare_udp.meet()
            bare_zenoh.meet()
            swarm.meet()
            for _ in range(4):
                swarm.beat()
                time.sleep(0.5)
            swarm.fly(2 * SETTLING_S, put)
            bare_zenoh.clear()
            bare_udp.clear()
            began_s, began_ns, load = time.monotonic(), time.time_ns(), os.getloadavg()[0]
            used_s = cpu_s(service.pid), cpu_s(router_pid)
            swarm.fly(options.seconds, put)
            wall_s = time.monotonic() - began_s
            cores = (cpu_s(service.pid) - used_s[0]) / wall_s, (cpu_s(router_pid) - used_s[1]) / wall_s
            swarm.listen(1.0)
            bare_udp.drain()
            bare_zenoh.drain()
            if (status := service.poll()) is not None:
                raise RuntimeError(f"the service ended with status {status} while it was measured")
        latencies_ms = list(stops.latencies_ms(began_ns))
        seen_ms = [latency_ms for latency_ms in latencies_ms if latency_ms is not None]
        return Round(seen_ms, len(latencies_ms) - len(seen_ms), bare_zenoh, bare_udp, *cores, load)


def percentile(latencies_ms: list[float], percent: int) -> float:
    return statistics.quantiles(latencies_ms, n=100)[percent - 1]


def row(name: str, latencies_ms: list[float], unseen: int, floor_ms: float | None) -> str:
    p50_ms, p95_ms, p99_ms = (percentile(latencies_ms, percent) for percent in (50, 95, 99))
    ratio = "" if floor_ms is None else f"{p99_ms / floor_ms:.1f}"
    figures = f"{p50_ms:9.2f}{p95_ms:9.2f}{p99_ms:9.2f}{max(latencies_ms):9.2f}"
    return f"  {name:14}{len(latencies_ms):7}{unseen:9}{figures}{ratio:>9}"


def main(options: argparse.Namespace) -> int:
    if options.ahead:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))  # what it starts inherits this
    asked = f"recorded {options.recorded}, closed {options.closed}, ahead {options.ahead}"
    print(f"{options.vehicles} vehicles, {options.seconds:g} s a round, {asked}")
    print(f"{'':16}{'count':>7}{'unseen':>9}{'p50 ms':>9}{'p95 ms':>9}{'p99 ms':>9}{'max ms':>9}{'x zenoh':>9}")
    p99s_ms, unseen = [], 0
    with contextlib.ExitStack() as stack:
        if options.closed:
            endpoint, router_pid, keys = stack.enter_context(
                closed_router([f"U{n}" for n in range(1, options.vehicles + 1)])
            )
        else:
            (endpoint, router_pid), keys = stack.enter_context(router()), None
        for number in range(1, options.rounds + 1):
            flown = measure(endpoint, router_pid, keys, options)
            floor_ms = percentile(flown.zenoh.latencies_ms, 99)
            print(
                f"round {number}: load {flown.load:.1f} on {os.cpu_count()} processors, "
                f"service {flown.service_core:.0%} of a core, router {flown.router_core:.0%}"
            )
            for name, floor in (("bare UDP", flown.udp), ("bare zenoh", flown.zenoh)):
                print(row(name, floor.latencies_ms, floor.asked - len(floor.latencies_ms), None))
            print(row("stop", flown.stops, flown.unseen, floor_ms), flush=True)
            p99s_ms.append(percentile(flown.stops, 99))
            unseen += flown.unseen
    p99_ms = statistics.median(p99s_ms)
    met = p99_ms < LARGEST_P99_MS and not unseen
    demanded = f"every stop comes, p99 below {LARGEST_P99_MS:g} ms"
    print(f"median p99 of the rounds {p99_ms:.2f} ms; {demanded}: {'yes' if met else 'NO'}")
    return 0 if met else 1


def play(role: str, port: int, *arguments: str, recorded: bool, keys: Path | None) -> None:
    """Be one of those that answer."""
    if role == "udp":
        answer_from_udp(port)
    elif role == "zenoh":
        answer_from_zenoh(arguments[0], port, *arguments[1:], keys=keys)
    else:
        asyncio.run(serve(arguments[0], port, int(arguments[1]), recorded=recorded, keys=keys))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--recorded", action="store_true", help="record the flight as a run does")
    parser.add_argument("--closed", action="store_true", help="a bus that is closed to strangers")
    parser.add_argument("--ahead", action="store_true", help="go ahead of everything else on this machine")
    parser.add_argument("--keys", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--role", help=argparse.SUPPRESS)
    parser.add_argument("arguments", nargs="*", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.role:
        play(given.role, int(given.arguments[0]), *given.arguments[1:], recorded=given.recorded, keys=given.keys)
    else:
        sys.exit(main(given))
