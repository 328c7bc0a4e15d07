"""A hundred vehicles on a hundred links in one process, against pymavlink's mavutil under select, in the same run.

    python -m tests.benchmarks.bench_links [--vehicles N] [--seconds S] [--repeats R] [--signed] [--recorded]

Another process plays the vehicles over real UDP on loopback: each sends GLOBAL_POSITION_INT at 10 Hz and heartbeat,
SYS_STATUS, EKF_STATUS_REPORT and ATTITUDE at 1 Hz, and is sent velocity setpoints at 10 Hz: by the leased streamer in
this service, by a plain timer in mavutil's loop. The setpoints are numbered by their speed, and timed by the receiving
kernel. Jitter is how far the interval from one number to the next is from 100 ms.

Prints the share of one core, jitter and loss of each, and exits 1 when this service takes 60 % of a core or more, or
its p99 jitter is 20 ms or more. Other load on the machine shows in jitter first: "waited" is the share of the time that
the process was ready to run and had no core.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import heapq
import itertools
import multiprocessing
import os
import resource
import select
import socket
import statistics
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

os.environ["MAVLINK20"] = "1"
os.environ["MAVLINK_DIALECT"] = "ardupilotmega"

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import SystemClock
from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import Link, open_link
from drivers.mavlink.setpoint_messages import velocity_setpoint
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits
from drivers.mavlink.signing import LinkSigner, open_signing
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import SigningKey
from drivers.mavlink.tlog import open_tlogs
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle

LOOPBACK = "127.0.0.1"
RATE_HZ = 10
WARM_UP_S = 3.0
LARGEST_CORE = 0.60
LARGEST_JITTER_MS = 20.0
GUIDED = 4
KEY = SigningKey(bytes(range(1, 33)))
NUMBERS = 3000
"""Setpoints are numbered modulo this, in mm/s above 1 m/s."""
SO_TIMESTAMPNS = 35
_SETPOINT_ID = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
_NORTH_AT = 26


@dataclass(frozen=True)
class Window:
    """What is measured, by the machine's monotonic clock, s."""

    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Options:
    vehicles: int
    signed: bool
    recorded: bool


@dataclass(frozen=True)
class Wire:
    """What the vehicles saw."""

    intervals_s: list[float]
    lost: int
    repeated: int
    sent: int


@dataclass(frozen=True)
class Station:
    """What the process under test took, and heard."""

    core: float
    user: float
    waited: float
    heard: int


def speed_of(number: int) -> float:
    return 1.0 + number % NUMBERS * 1e-3


# --- the vehicles


def telemetry(system_id: int) -> Iterator[tuple[float, float, mavlink.MAVLink_message]]:
    """Yield first time, period and content of what a vehicle sends."""
    position = mavlink.MAVLink_global_position_int_message(
        1000, 474_000_000 + system_id, 85_000_000, 430_000, 10_000, 150, -250, 5, 9000
    )
    others = (
        mavlink.MAVLink_heartbeat_message(2, 3, 0x81, GUIDED, 4, 3),
        mavlink.MAVLink_sys_status_message(1, 1, 1, 500, 12_000, -1, 90, *(0,) * 6),
        mavlink.MAVLink_ekf_status_report_message(831, 0.1, 0.1, 0.1, 0.1, 0.1),
        mavlink.MAVLink_attitude_message(1000, 0.1, 0.1, 0.1, 0.0, 0.0, 0.0),
    )
    phase_s = system_id * 0.618 % 1.0
    yield phase_s / RATE_HZ, 1.0 / RATE_HZ, position
    for number, message in enumerate(others):
        yield (phase_s + number / len(others)) % 1.0, 1.0, message


def play_vehicles(results: Connection, ports: list[int], signed: bool, window: Window) -> None:
    """Send the telemetry of all, and note when their setpoints come in."""
    poller, sockets, codecs = select.poll(), [], []
    due: list[tuple[float, int, int, float, mavlink.MAVLink_message]] = []
    heard: dict[int, list[tuple[float, int]]] = {}
    order = itertools.count()
    signing_clock = SigningClock(SystemClock())
    begin_s = time.monotonic()
    for system_id, port in enumerate(ports, start=1):
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        link.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        link.connect((LOOPBACK, port))
        poller.register(link, select.POLLIN)
        sockets.append(link)
        heard[link.fileno()] = []
        codecs.append(Codec(system_id, 1, signing=LinkSigner(KEY, signing_clock, 1, "") if signed else None))
        for first_s, period_s, message in telemetry(system_id):
            due.append((begin_s + first_s, next(order), system_id - 1, period_s, message))
    heapq.heapify(due)
    by_descriptor = {link.fileno(): link for link in sockets}
    sent = 0
    while (now_s := time.monotonic()) < window.end_s:
        while due[0][0] <= now_s:
            due_s, _, index, period_s, message = due[0]
            sockets[index].send(codecs[index].encode(message))
            sent += window.begin_s <= due_s
            heapq.heapreplace(due, (due_s + period_s, next(order), index, period_s, message))
        for descriptor, _ in poller.poll(max(0.0, due[0][0] - time.monotonic()) * 1e3):
            note_setpoint(by_descriptor[descriptor], heard[descriptor])
    results.send((summary(list(heard.values()), window), sent))


def note_setpoint(link: socket.socket, heard: list[tuple[float, int]]) -> None:
    frame, ancillary, _, _ = link.recvmsg(1024, 64)
    if len(frame) > _NORTH_AT + 4 and frame[7] == _SETPOINT_ID and frame[8] == frame[9] == 0:
        seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
        (north_mps,) = struct.unpack_from("<f", frame, _NORTH_AT)
        heard.append((seconds + nanoseconds * 1e-9, round((north_mps - 1.0) * 1e3)))


def summary(streams: list[list[tuple[float, int]]], window: Window) -> Wire:
    """Return the intervals from each number to the next that came within the window, and how many never came."""
    to_unix_s = time.time() - time.monotonic()
    intervals_s: list[float] = []
    lost = repeated = count = 0
    for stream in streams:
        within = [(t, number) for t, number in stream if window.begin_s <= t - to_unix_s < window.end_s]
        count += len(within)
        for (earlier_s, earlier), (later_s, later) in itertools.pairwise(first_of_each(within)):
            missing = (later - earlier) % NUMBERS - 1
            lost += missing
            intervals_s.append((later_s - earlier_s) / (missing + 1))
        repeated += len(within) - len(first_of_each(within))
    return Wire(intervals_s, lost, repeated, count)


def first_of_each(stream: list[tuple[float, int]]) -> list[tuple[float, int]]:
    return [next(same) for _, same in itertools.groupby(stream, key=lambda item: item[1])]


# --- the process under test


class Usage:
    """The processor time of this process over the window."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._before, self._waited_before_s = resource.getrusage(resource.RUSAGE_SELF), waited_s()

    def station(self, heard: int) -> Station:
        after = resource.getrusage(resource.RUSAGE_SELF)
        wall_s = time.monotonic() - self._window.begin_s
        user_s, system_s = after.ru_utime - self._before.ru_utime, after.ru_stime - self._before.ru_stime
        waited = (waited_s() - self._waited_before_s) / wall_s
        return Station((user_s + system_s) / wall_s, user_s / wall_s, waited, heard)


def waited_s() -> float:
    """Return for how long this process's main thread has been ready to run without a core, s (Linux)."""
    return int(Path("/proc/self/schedstat").read_text().split()[1]) * 1e-9


def this_service(orchestrator: Connection, options: Options) -> None:
    asyncio.run(serve(orchestrator, options))


async def serve(orchestrator: Connection, options: Options) -> None:
    clock = SystemClock()
    async with contextlib.AsyncExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        signing = await stack.enter_async_context(open_signing(clock, folder / "state")) if options.signed else None
        tlogs = await stack.enter_async_context(open_tlogs(folder, clock)) if options.recorded else None
        links: list[Link] = []
        for number in range(options.vehicles):
            codec = Codec(signing=signing and signing.link(KEY, f"link {number}"))
            address = LinkAddress("udpin", LOOPBACK, 0)
            log = tlogs and tlogs.of(f"link {number}")
            links.append(await stack.enter_async_context(open_link(address, codec, clock, log)))
        vehicles = [Vehicle(f"U{k}", k, link, clock) for k, link in enumerate(links, start=1)]
        orchestrator.send([link.address.port for link in links])
        window: Window = await asyncio.to_thread(orchestrator.recv)
        async with asyncio.TaskGroup() as group:
            flights = [group.create_task(fly(vehicle, clock)) for vehicle in vehicles]
            await clock.sleep(window.begin_s - time.monotonic())
            usage, before = Usage(window), sum(link.counters.received for link in links)
            await clock.sleep(window.end_s - time.monotonic())
            orchestrator.send(usage.station(sum(link.counters.received for link in links) - before))
            for flight in flights:
                flight.cancel()


async def fly(vehicle: Vehicle, clock: SystemClock) -> None:
    """Renew a vehicle's lease ten times a second, as bearings would."""
    await vehicle.wait_until(lambda: vehicle.telemetry.heartbeat is not None, 10.0, "heartbeat", "")
    stream = SetpointStreamer(vehicle, ArduCopter(), 10.0, StreamLimits(rate_hz=RATE_HZ), clock)
    async with asyncio.TaskGroup() as group:
        group.create_task(stream.run())
        due_s = clock.now_s()
        for number in itertools.count():
            stream.renew(complex(speed_of(number)))
            due_s += 1.0 / RATE_HZ
            await clock.sleep(due_s - clock.now_s())


def mavutil_select(orchestrator: Connection, options: Options) -> None:
    """Do the same with mavutil: one loop over all sockets, a message for each that is readable, timers for the rest."""
    links = [mavutil.mavlink_connection(f"udpin:{LOOPBACK}:0", source_system=255) for _ in range(options.vehicles)]
    by_descriptor = {link.port.fileno(): link for link in links}
    orchestrator.send([link.port.getsockname()[1] for link in links])
    window: Window = orchestrator.recv()
    due = [(time.monotonic() + k / len(links) / RATE_HZ, k, 0) for k in range(len(links))]
    state: dict[int, dict[int, Any]] = {k: {} for k in by_descriptor}
    usage, heard = None, 0
    while (now_s := time.monotonic()) < window.end_s:
        if usage is None and now_s >= window.begin_s:
            usage, heard = Usage(window), 0
        while due[0][0] <= now_s:
            due_s, k, number = due[0]
            heapq.heapreplace(due, (due_s + 1.0 / RATE_HZ, k, number + 1))
            if number % RATE_HZ == 0:
                links[k].mav.heartbeat_send(6, 8, 0, 0, 4)
            links[k].mav.send(velocity_setpoint(k + 1, complex(speed_of(number)), 0.0))
        for descriptor in select.select(by_descriptor, (), (), max(0.0, due[0][0] - time.monotonic()))[0]:
            message = by_descriptor[descriptor].recv_msg()
            if message is not None:
                state[descriptor][message.get_msgId()] = message
                heard += 1
    assert usage is not None
    orchestrator.send(usage.station(heard))


# --- one run of each, side by side

Role = Callable[[Connection, Options], None]


def measure(role: Role, options: Options, seconds: float) -> tuple[Station, Wire, int]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    station = context.Process(target=role, args=(theirs, options))
    station.start()
    ports = ours.recv()
    begin_s = time.monotonic() + WARM_UP_S
    window = Window(begin_s, begin_s + seconds)
    results, writing = context.Pipe(duplex=False)
    vehicles = context.Process(target=play_vehicles, args=(writing, ports, options.signed, window))
    vehicles.start()
    ours.send(window)
    used: Station = ours.recv()
    wire, sent = results.recv()
    for process in (station, vehicles):
        process.join(10.0)
        process.kill()
    return used, wire, sent


def percentile_ms(deviations_s: list[float], share: float) -> float:
    return 1e3 * sorted(deviations_s)[min(len(deviations_s) - 1, int(share * len(deviations_s)))]


def main(options: Options, seconds: float, repeats: int) -> int:
    roles: dict[str, Role] = {"this service": this_service, "mavutil, select": mavutil_select}
    if options.signed:
        del roles["mavutil, select"]  # it signs with a clock of its own for each link: another job
    print(f"{options.vehicles} vehicles, {seconds:g} s each, signed {options.signed}, recorded {options.recorded}")
    print(
        f"{'':18}{'core':>7}{'user':>7}{'jitter p50':>12}{'p99 ms':>8}{'waited':>9}"
        f"{'setpoints/s':>13}{'lost':>8}{'heard':>9}"
    )
    cores: dict[str, list[float]] = {name: [] for name in roles}
    jitters_ms: list[float] = []
    for _ in range(repeats):
        for name, role in roles.items():
            used, wire, sent = measure(role, options, seconds)
            jitter_s = [abs(interval_s - 1.0 / RATE_HZ) for interval_s in wire.intervals_s]
            p50_ms, p99_ms = percentile_ms(jitter_s, 0.50), percentile_ms(jitter_s, 0.99)
            cores[name].append(used.core)
            if role is this_service:
                jitters_ms.append(p99_ms)
            share_lost = wire.lost / (wire.lost + len(wire.intervals_s))
            print(
                f"{name:18}{used.core:7.1%}{used.user:7.1%}{p50_ms:12.2f}{p99_ms:8.2f}"
                f"{used.waited:9.1%}"
                f"{wire.sent / seconds:13.1f}{share_lost:8.2%}{used.heard / sent:9.2%}"
            )
    core, jitter_ms = statistics.median(cores["this service"]), statistics.median(jitters_ms)
    for name, shares in cores.items():
        print(f"{name:18} takes {statistics.median(shares) / core:.2f} times the processor time of this service")
    met = core < LARGEST_CORE and jitter_ms < LARGEST_JITTER_MS
    print(f"below {LARGEST_CORE:.0%} of a core and p99 jitter below {LARGEST_JITTER_MS:g} ms: {'yes' if met else 'NO'}")
    return 0 if met else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--signed", action="store_true", help="sign every frame, both ways")
    parser.add_argument("--recorded", action="store_true", help="write a .tlog of every link")
    given = parser.parse_args()
    sys.exit(main(Options(given.vehicles, given.signed, given.recorded), given.seconds, given.repeats))
