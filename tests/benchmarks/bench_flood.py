"""A flood: 50,000 messages a second on the bus and bytes on the MAVLink port, and a service that flies on meanwhile.

    python -m tests.benchmarks.bench_flood [--rate N] [--seconds S] [--recorded] [--only KIND]

One service process flies a few vehicles to and fro; its UDP port takes anybody's datagrams. Then two others flood:
bearing reports of a sender nobody knows, of ever new ones, and in the name of one vehicle; malformed and oversized
ones, control queries, and on the UDP port noise and frames of other systems. In the last quarter of the flood all
sensors fall silent.

Prints what was offered, what the service counted, its memory and the router's, and how the vehicles that are not
spoken for were steered. Exits 1 when memory grows by more than it may, when a vehicle is moved on without bearings, or
when the service ends.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import json
import os
import socket
import statistics
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import zenoh

from drivers.bus.messages import BearingReport, ControlReply, encode
from drivers.bus.session import BusEndpoint
from drivers.mavlink.setpoints import StreamLimits
from drivers.mavlink.transport import LinkAddress
from gcs.monitor.proven import ControlGuard
from tests.benchmarks.answering import SETTINGS, held_by, open_station, process, router, until_terminated
from tests.benchmarks.flooding import KINDS, VICTIM, flood
from tests.benchmarks.swarm import KEYS, Arrival, Swarm, bearing_publisher, timed_socket
from tests.benchmarks.to_and_fro import recording_of, to_and_fro

VEHICLES = VICTIM
"""All but the last are spoken for by nobody else."""
QUIET_S = 5.0
STARTING_S = 2.0
LARGEST_GROWTH_MB = 200.0
LARGEST_LATE_GROWTH_MB = 40.0
"""From the middle of the flood to its end."""
LIMITS = StreamLimits()
STOPS_WITHIN_S = SETTINGS.gap_s + LIMITS.lease_s + 0.5


async def serve(endpoint: str, port: int, told: Path, *, recorded: bool) -> None:
    """Fly the vehicles to and fro until told to end, then write what was counted."""
    asked: Counter[str] = Counter()

    def answer(_payload: bytes) -> bytes:
        asked["control"] += 1
        return encode(ControlReply(ok=False, message="nothing is held"))

    address = LinkAddress("udpin", "127.0.0.1", port)
    async with (
        open_station(endpoint, address, VEHICLES, LIMITS) as station,
        recording_of(station, recorded=recorded) as trace,
    ):
        station.bus.serve(KEYS.control, ControlGuard(KEYS.swarm, answer, None).take)
        for number in range(1, VEHICLES + 1):
            station.start(to_and_fro(station, number, VEHICLES, trace))
        await until_terminated()
        link = station.link.status(station.clock.now_s())
        counted = {
            "bearings": {name: count for name, count in vars(station.feed.counters).items() if count},
            "bus": vars(station.bus.losses),
            "control": asked["control"],
            "link": {"received": link.received, "refused": link.refused, "skipped_bytes": link.skipped_bytes},
        }
        await asyncio.to_thread(told.write_text, json.dumps(counted, default=vars))


@dataclass
class Steering:
    """How the vehicles were steered: when each setpoint came, and whether it moved its vehicle."""

    setpoints: defaultdict[int, list[tuple[int, bool]]] = field(default_factory=lambda: defaultdict(list))
    heard: bool = False
    """Whether the service has said anything."""

    def take(self, arrival: Arrival) -> None:
        """Note a setpoint."""
        self.heard = True
        if arrival.number is not None and arrival.velocity is not None:
            self.setpoints[arrival.number].append((arrival.time_ns, arrival.velocity != 0j))

    def line(self, name: str, began_ns: int, ended_ns: int) -> str:
        """Return how those nobody speaks for were steered in a time, in words."""
        rates, moving, gaps_s = [], 0, [0.0]
        for number in range(1, VEHICLES):
            within = [(at, moves) for at, moves in self.setpoints[number] if began_ns <= at < ended_ns]
            rates.append(len(within) / (ended_ns - began_ns) * 1e9)
            moving += sum(moves for _, moves in within)
            gaps_s += [(later - earlier) * 1e-9 for (earlier, _), (later, _) in itertools.pairwise(within)]
        total = max(1.0, sum(rates) * (ended_ns - began_ns) * 1e-9)
        return (
            f"  {name:26}{statistics.mean(rates):8.1f} setpoints/s each, {moving / total:4.0%} of them moving, "
            f"longest gap {max(gaps_s):.2f} s"
        )

    def last_moving_s(self, since_ns: int, until_ns: int) -> float:
        """Return how long after a time the last setpoint of those left before another that moved anybody came, s."""
        moving = [
            at
            for number in range(1, VEHICLES)
            for at, moves in self.setpoints[number]
            if moves and since_ns <= at < until_ns
        ]
        return (max(moving) - since_ns) * 1e-9 if moving else 0.0


@dataclass
class Memory:
    """Samples the resident memory of processes, MB."""

    pids: dict[str, int]
    samples: dict[str, list[tuple[int, float]]] = field(default_factory=lambda: defaultdict(list))

    @contextlib.contextmanager
    def sampled(self) -> Iterator[None]:
        """Sample while the block lasts."""
        ended = threading.Event()

        def sample() -> None:
            while not ended.wait(0.1):
                for name, pid in self.pids.items():
                    with contextlib.suppress(OSError, KeyError):  # it has ended
                        self.samples[name].append((time.time_ns(), held_by(pid)["memory MB"]))

        thread = threading.Thread(target=sample)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def at(self, name: str, time_ns: int) -> float:
        """Return the memory at a time."""
        return min(self.samples[name], key=lambda sample: abs(sample[0] - time_ns))[1]

    def peak(self, name: str) -> float:
        """Return the largest."""
        return max(mb for _, mb in self.samples[name])


@dataclass(frozen=True)
class Flown:
    """What became of a flight. Times are those at which its parts began, and its end."""

    steering: Steering
    memory: Memory
    before_ns: int
    flooded_ns: int
    silent_ns: int
    ended_ns: int
    quiet_ns: int
    after_ns: int
    counted: str | None
    """By the service; None when it did not end in order."""


def fly(options: argparse.Namespace) -> Flown:
    """Fly before the flood, through it, and after."""
    with (
        router() as (endpoint, router_pid),
        zenoh.open(BusEndpoint(endpoint).configuration()) as session,
        timed_socket() as port_in,
        tempfile.TemporaryDirectory() as folder,
    ):
        steering, told, port = Steering(), Path(folder) / "counted.json", _free_udp_port()
        swarm = Swarm(VEHICLES, port_in, steering.take, positions=True, answering=("127.0.0.1", port))
        publishers = {number: bearing_publisher(session, number) for number in swarm.places}

        def put(number: int, report: BearingReport) -> None:
            publishers[number].put(encode(report))

        this = ("-m", "tests.benchmarks.bench_flood", "--role")
        recorded = ["--recorded"] if options.recorded else []
        with process(*this, "service", endpoint, str(port), str(told), *recorded) as service:
            while not steering.heard:
                swarm.beat()
                swarm.listen(0.5)
            time.sleep(STARTING_S)
            memory = Memory({"service": service.pid, "router": router_pid})
            halves = ([options.only],) if options.only else (KINDS[:4], KINDS[4:])
            with memory.sampled():
                times_ns = [time.time_ns()]
                swarm.fly(QUIET_S, put)
                times_ns.append(time.time_ns())
                with contextlib.ExitStack() as stack:
                    for half in halves:
                        flooding = (*this, "flood", endpoint, str(port), str(options.rate), *half)
                        stack.enter_context(process(*flooding))
                    swarm.fly(0.75 * options.seconds, put)
                    times_ns.append(time.time_ns())
                    swarm.fly(0.25 * options.seconds, lambda _number, _report: None)
                    times_ns.append(time.time_ns())
                times_ns.append(time.time_ns())
                swarm.fly(QUIET_S, put)
                times_ns.append(time.time_ns())
            service.terminate()
            service.wait(20.0)
        return Flown(steering, memory, *times_ns, told.read_text() if told.exists() else None)


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def main(options: argparse.Namespace) -> int:
    print(f"load before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors", flush=True)
    flown = fly(options)
    steering, memory = flown.steering, flown.memory
    print("steered, of those nobody else speaks for:")
    print(steering.line("before", flown.before_ns, flown.flooded_ns))
    print(steering.line("flooded", flown.flooded_ns, flown.silent_ns))
    print(steering.line("flooded, sensors silent", flown.silent_ns, flown.ended_ns))
    print(steering.line("after", flown.quiet_ns, flown.after_ns))
    ran_on_s = steering.last_moving_s(flown.silent_ns, flown.ended_ns)
    print(f"  moved for {ran_on_s:.2f} s after the last bearing (at most {STOPS_WITHIN_S:g} s)")
    middle_ns = (flown.flooded_ns + flown.ended_ns) // 2
    at_ns = {"before": flown.flooded_ns, "middle": middle_ns, "end": flown.ended_ns, "after": flown.after_ns}
    for name in memory.pids:
        words = ", ".join(f"{when} {memory.at(name, time_ns):.0f}" for when, time_ns in at_ns.items())
        print(f"{name}: MB {words}, peak {memory.peak(name):.0f}")
    print(f"counted by the service: {flown.counted or 'nothing: it did not end in order'}")
    growth_mb = memory.peak("service") - memory.at("service", flown.flooded_ns)
    late_mb = memory.at("service", flown.ended_ns) - memory.at("service", middle_ns)
    met = flown.counted is not None and ran_on_s <= STOPS_WITHIN_S
    met = met and growth_mb <= LARGEST_GROWTH_MB and late_mb <= LARGEST_LATE_GROWTH_MB
    print(f"memory bounded, nobody runs on, the service lives: {'yes' if met else 'NO'}")
    return 0 if met else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rate", type=float, default=50_000.0, help="messages a second on the bus")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--recorded", action="store_true", help="record the flight as a run does")
    parser.add_argument("--only", choices=KINDS, help="flood with one kind alone")
    parser.add_argument("--role", help=argparse.SUPPRESS)
    parser.add_argument("arguments", nargs="*", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.role == "service":
        asyncio.run(
            serve(given.arguments[0], int(given.arguments[1]), Path(given.arguments[2]), recorded=given.recorded)
        )
    elif given.role == "flood":
        flood(given.arguments[0], int(given.arguments[1]), float(given.arguments[2]), *given.arguments[3:])
    else:
        sys.exit(main(given))
