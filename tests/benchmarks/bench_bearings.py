"""From a bearing report on the bus to the setpoint it causes on the wire, beside what the transports alone cost.

    python -m tests.benchmarks.bench_bearings [seconds per measurement [receivers]]

A probe flies 20, 100 and 200 receivers, each on a leg, and reports their bearings 10 times a second through a bus
router of its own process. Three others answer each report with one datagram: the service's own chain (feed, stop
monitor, guidance, leased stream, link), a bare zenoh subscriber, and a bare UDP socket without any bus. The datagram's
time is the kernel's when it arrives. Exits 1 unless, at 100 receivers, the service answers 99 % of the reports, its
p99 is within 5 times that of bare zenoh, and it takes less than one core.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import zenoh

from drivers.aoa.model import SensorModel, SimulatedSensor
from drivers.bus.messages import BearingReport, encode
from drivers.bus.session import BusEndpoint
from drivers.clock import SystemClock
from drivers.mavlink.setpoints import StreamLimits
from gcs.bearings import BearingFeed
from gcs.stop_monitor import TURN, StopMonitor
from planner.plan import Leg
from tests.benchmarks.answering import (
    answer_from_udp,
    answer_from_zenoh,
    cpu_s,
    open_station,
    process,
    router,
    to_port,
    until_terminated,
)
from tests.benchmarks.swarm import (
    FRAME,
    KEYS,
    RATE_HZ,
    SIGMA_RAD,
    TRANSMITTERS,
    Arrival,
    Swarm,
    bearing_publisher,
    leg_between,
    start_of,
    timed_socket,
)

RECEIVERS = (20, 100, 200)
SECONDS = 8.0
SETTLING_S = 3.0
LARGEST_RATIO, LARGEST_LOSS, JUDGED = 5.0, 0.01, 100


def leg_of(number: int, count: int) -> Leg:
    """Return a leg of 300 m straight away from L0: longer than a measurement lasts."""
    start = start_of(number, count)
    return leg_between(start, start * (1.0 + 300.0 / abs(start)))


async def serve(endpoint: str, port: int, count: int) -> None:
    """Fly every receiver's leg as the service does; its setpoints go to one UDP port."""
    limits = StreamLimits(rate_hz=2.0)  # no repeats between renewals: every setpoint answers a report
    async with open_station(endpoint, to_port(port), count, limits) as station:
        with contextlib.ExitStack() as stack:
            for number in range(1, count + 1):
                name, leg = f"U{number}", leg_of(number, count)
                monitor = StopMonitor(leg, TRANSMITTERS, leg.start, np.eye(2), station.clock.now_s(), TURN)
                listening = stack.enter_context(station.feed.listen(name))
                station.start(station.flight(name, leg, monitor, listening).fly())
            await until_terminated()


# The probe


@dataclass
class Result:
    """What one measurement gave."""

    latencies_ms: list[float] = field(default_factory=list)
    reports: int = 0
    share: float = 0.0

    def percentile(self, percent: int) -> float:
        return statistics.quantiles(self.latencies_ms, n=100)[percent - 1]

    @property
    def lost(self) -> float:
        """Share of the reports that were not answered: without them a percentile says nothing."""
        return 1.0 - len(self.latencies_ms) / self.reports

    def row(self, name: str, count: int, floor: Result | None) -> str:
        load, reports_s = f"{count} x {RATE_HZ:.0f} Hz", count * RATE_HZ
        ratio = f"{self.percentile(99) / floor.percentile(99):.1f}" if floor else ""
        return (
            f"{load:12}{name:12}{1e6 * self.share / reports_s:10.0f}{100 * self.share:8.0f} %"
            f"{self.percentile(50):9.2f}{self.percentile(99):9.2f}{ratio:>9}{100 * self.lost:11.2f} %"
        )


@dataclass
class Probe:
    """Reports the swarm's bearings, and times the answers."""

    result: Result = field(default_factory=Result)
    asked_ns: dict[int, int] = field(default_factory=dict)

    def fly(self, swarm: Swarm, put: Callable[[int, bytes], None], pid: int, seconds: float) -> Result:
        """Report for a while; the first seconds do not count."""

        def report(number: int, measured: BearingReport) -> None:
            payload = encode(measured)
            self.asked_ns[number] = time.time_ns()
            self.result.reports += 1
            put(number, payload)

        swarm.fly(SETTLING_S, report)
        self.result = Result()
        self.asked_ns.clear()
        began_s, began_cpu_s = time.monotonic(), cpu_s(pid)
        swarm.fly(seconds, report)
        swarm.listen()
        self.result.share = (cpu_s(pid) - began_cpu_s) / (time.monotonic() - began_s)
        return self.result

    def take(self, arrival: Arrival) -> None:
        """Note what answers a report."""
        asked_ns = None if arrival.number is None else self.asked_ns.pop(arrival.number, None)
        if asked_ns is not None:
            self.result.latencies_ms.append((arrival.time_ns - asked_ns) * 1e-6)


def measure(who: str, count: int, endpoint: str, session: zenoh.Session, seconds: float) -> Result:
    """Start one of the three, and fly against it."""
    with timed_socket() as port_in:
        probe = Probe()
        swarm = Swarm(count, port_in, probe.take)
        publishers = {n: bearing_publisher(session, n) for n in swarm.places}

        def put_on_bus(number: int, payload: bytes) -> None:
            publishers[number].put(payload)

        def put_on_wire(number: int, payload: bytes) -> None:
            port_in.sendto(bytes([number]) + payload, swarm.answering)

        arguments = ("-m", "tests.benchmarks.bench_bearings", who, endpoint, str(port_in.getsockname()[1]), str(count))
        with process(*arguments) as answering:
            swarm.meet()
            if who == "service":
                for _ in range(4):
                    swarm.beat()
                    time.sleep(0.5)
            result = probe.fly(swarm, put_on_wire if who == "bare UDP" else put_on_bus, answering.pid, seconds)
            if (status := answering.poll()) is not None:
                raise RuntimeError(f"{who} ended with status {status} while it was measured")
            return result


def take_us(count: int = 20_000) -> float:
    """Return what one report costs in the feed alone: decoded, checked, converted, handed out, us."""
    clock = SystemClock()
    feed = BearingFeed(["U1"], FRAME, clock, 0.5)
    sensor = SimulatedSensor(SensorModel(SIGMA_RAD), random.Random(1))
    places = {name: FRAME.to_site(at) for name, at in TRANSMITTERS.items()}
    payloads = [encode(sensor.measure(clock.unix_ns(), 50j, places)) for _ in range(count)]  # type: ignore[arg-type]
    key, took_s = KEYS.bearings("U1"), 0.0
    for payload in payloads:
        begin = time.perf_counter()
        feed.take(key, payload)
        took_s += time.perf_counter() - begin
    assert feed.counters.received == count
    return 1e6 * took_s / count


def main(seconds: float, *counts: int) -> int:
    met = False
    print(f"load before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(f"the feed alone: {take_us():.1f} us per report")
    print(f"{'':24}{'us/report':>10}{'core':>10}{'p50 ms':>9}{'p99 ms':>9}{'x zenoh':>9}{'unanswered':>13}")
    with router() as (endpoint, _), zenoh.open(BusEndpoint(endpoint).configuration()) as session:
        for count in counts or RECEIVERS:
            udp, bare, service = (
                measure(who, count, endpoint, session, seconds) for who in ("bare UDP", "bare zenoh", "service")
            )
            for name, result in (("bare UDP", udp), ("bare zenoh", bare), ("service", service)):
                print(result.row(name, count, None if name == "bare UDP" else bare), flush=True)
            if count == JUDGED:
                met = service.percentile(99) <= LARGEST_RATIO * bare.percentile(99) and service.share < 1.0
                met = met and service.lost <= LARGEST_LOSS
    asked = f"99 % answered, p99 within {LARGEST_RATIO:g} x bare zenoh, under one core"
    print(f"{JUDGED} receivers: {asked}: {'yes' if met else 'NO'}")
    return 0 if met else 1


if __name__ == "__main__":
    if len(sys.argv) > 1 and not sys.argv[1][0].isdigit():
        role, bus_endpoint, port, receivers = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
        if role == "service":
            asyncio.run(serve(bus_endpoint, port, receivers))
        elif role == "bare zenoh":
            answer_from_zenoh(bus_endpoint, port, KEYS.every_bearings)
        else:
            answer_from_udp(port)
    else:
        sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS, *map(int, sys.argv[2:])))
