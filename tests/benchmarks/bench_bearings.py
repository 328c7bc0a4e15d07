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
import cmath
import contextlib
import math
import os
import random
import select
import signal
import socket
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import zenoh
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.aoa.model import SensorModel, SimulatedSensor
from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import encode
from drivers.bus.session import BusEndpoint, open_bus
from drivers.clock import SystemClock
from drivers.mavlink.autopilots import autopilot_of
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import open_link
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import free_tcp_port
from drivers.tasks import open_background
from gcs.bearings import BearingFeed
from gcs.clock_offsets import ClockOffsets
from gcs.relay.leg_flight import LegFlight
from gcs.relay.records import ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.stop_monitor import TURN, StopMonitor
from planner.frames import FormationFrame
from planner.plan import Leg, Route

RATE_HZ = 10.0
RECEIVERS = (20, 100, 200)
SECONDS = 8.0
SETTLING_S = 3.0
RESPONSE_S = 0.5
LARGEST_RATIO, LARGEST_LOSS, JUDGED = 5.0, 0.01, 100
KEYS = SwarmKeys("bench")
FRAME = FormationFrame(math.radians(90.0))
TRANSMITTERS = {"L0": 0j, "L1": complex(200.0)}
SIGMA_RAD = math.radians(0.1)
SO_TIMESTAMPNS = 35
MAVLINK_HEADER, VELOCITY_AT, TARGET_AT = 10, 16, 50
"""Of SET_POSITION_TARGET_LOCAL_NED: where vx and vy, and the system meant, stand in the payload."""


def leg_of(number: int) -> Leg:
    """Return a leg of 300 m straight away from L0: longer than a measurement lasts."""
    start = cmath.rect(60.0 + 0.5 * number, 0.3 + 2.5 * number / max(RECEIVERS))
    end = start * (1.0 + 300.0 / abs(start))
    stop_angle_rad = cmath.phase((TRANSMITTERS["L1"] - end) / (TRANSMITTERS["L0"] - end))
    return Leg("L0", "away", ("L0", "L1"), stop_angle_rad, start, end)


# The three that answer


async def serve(endpoint: str, port: int, count: int) -> None:
    """Fly every receiver's leg as the service does; its setpoints go to one UDP port."""
    clock = SystemClock()
    settings = RelaySettings()
    names = {f"U{number}": number for number in range(1, count + 1)}
    clocks = ClockOffsets(names, clock)
    feed = BearingFeed(names, FRAME, clock, settings.gap_s, clocks)
    limits = StreamLimits(rate_hz=2.0)  # no repeats between renewals: every setpoint answers a report
    async with (
        open_bus(BusEndpoint(endpoint)) as bus,
        open_link(LinkAddress("udpout", "127.0.0.1", port), Codec(), clock) as link,
        open_background() as start,
    ):
        vehicles = {name: Vehicle(name, number, link, clock) for name, number in names.items()}
        for vehicle in vehicles.values():
            await vehicle.wait_until(lambda v=vehicle: v.telemetry.heartbeat is not None, 20.0, "heartbeat", "")
        clocks.attach(bus, KEYS)
        feed.attach(bus, KEYS)
        start(clocks.run())
        with contextlib.ExitStack() as stack:
            for name, vehicle in vehicles.items():
                leg = leg_of(names[name])
                stream = SetpointStreamer(vehicle, autopilot_of(vehicle), 20.0, limits, clock)
                start(stream.run())
                flight = LegFlight(
                    ReceiverRecord(Route(name, "O", 1, 1, "I", leg.start, leg.end, (leg,))),
                    StopMonitor(leg, TRANSMITTERS, leg.start, np.eye(2), clock.now_s(), TURN),
                    stream,
                    stack.enter_context(feed.listen(name)),
                    objection=lambda: None,
                    announce=lambda record: None,
                    frame=FRAME,
                    clock=clock,
                    settings=settings,
                )
                start(flight.fly())
            await _until_terminated()


async def _until_terminated() -> None:
    stopped = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stopped.set)
    await stopped.wait()


def a_setpoint(number: int) -> bytes:
    """Return a datagram like a setpoint for one vehicle, without what makes it MAVLink."""
    made = bytearray(MAVLINK_HEADER + TARGET_AT + 5)
    made[MAVLINK_HEADER + TARGET_AT] = number
    return bytes(made)


def answer_from_zenoh(endpoint: str, port: int, count: int) -> None:
    """Answer every report straight from the zenoh callback."""
    answers = {f"U{number}": a_setpoint(number) for number in range(1, count + 1)}
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect(("127.0.0.1", port))
    sender.send(b"here")

    def answer(sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()
        sender.send(answers[uav_of(str(sample.key_expr)) or ""])

    with zenoh.open(BusEndpoint(endpoint).configuration()) as session:
        session.declare_subscriber(KEYS.every_bearings, answer)
        signal.sigwait({signal.SIGTERM})


def answer_from_udp(port: int) -> None:
    """Answer every datagram: its first byte says whose it is."""
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect(("127.0.0.1", port))
    sender.send(b"here")
    while True:
        sender.send(a_setpoint(sender.recv(2048)[0]))


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
    """The swarm: reports bearings in turn, moves as it is told, and times the answers."""

    count: int
    port_in: socket.socket
    places: dict[int, complex] = field(init=False)
    velocities: dict[int, complex] = field(init=False)
    commands: dict[int, complex] = field(init=False)
    asked_ns: dict[int, int] = field(default_factory=dict)
    answering: tuple[str, int] = ("", 0)

    def __post_init__(self) -> None:
        numbers = range(1, self.count + 1)
        self.places = {number: FRAME.to_site(leg_of(number).start) for number in numbers}
        self.velocities = dict.fromkeys(numbers, 0j)
        self.commands = dict.fromkeys(numbers, 0j)
        self.transmitters = {name: FRAME.to_site(at) for name, at in TRANSMITTERS.items()}
        model = SensorModel(SIGMA_RAD)
        self.sensors = {n: SimulatedSensor(model, random.Random(f"1/U{n}")) for n in numbers}
        self.heartbeats = [self._heartbeat(number) for number in numbers]

    def fly(self, put: Callable[[int, bytes], None], pid: int, seconds: float) -> Result:
        """Report for a while; the first seconds do not count."""
        result, started_s = Result(), time.monotonic()
        counted_from_s, period_s = started_s + SETTLING_S, 1.0 / RATE_HZ / self.count
        began_cpu_s, number, turn = 0.0, 0, 0
        while (now_s := time.monotonic()) < counted_from_s + seconds:
            due_s = started_s + turn * period_s
            if now_s < due_s:
                self._listen(due_s - now_s, result)
                continue
            turn += 1
            if now_s >= counted_from_s and not result.reports:
                began_cpu_s, counted_from_s = cpu_s(pid), now_s
                result.latencies_ms.clear()
                self.asked_ns.clear()
            number = number % self.count + 1
            self._report(number, put)
            result.reports += now_s >= counted_from_s
            if turn % round(RATE_HZ) == 0:  # each vehicle's heartbeat comes once a second, at its own time
                self.port_in.sendto(self.heartbeats[turn // round(RATE_HZ) % self.count], self.answering)
        self._listen(0.2, result)
        result.share = (cpu_s(pid) - began_cpu_s) / (time.monotonic() - counted_from_s)
        return result

    def beat(self) -> None:
        """Let every vehicle say at once that it is there, in its guided mode."""
        for heartbeat in self.heartbeats:
            self.port_in.sendto(heartbeat, self.answering)

    def _report(self, number: int, put: Callable[[int, bytes], None]) -> None:
        period_s = 1.0 / RATE_HZ
        follow = 1.0 - math.exp(-period_s / RESPONSE_S)
        self.velocities[number] += (self.commands[number] - self.velocities[number]) * follow
        self.places[number] += self.velocities[number] * period_s
        report = self.sensors[number].measure(time.time_ns(), self.places[number], self.transmitters)
        assert report is not None
        payload = encode(report)
        self.asked_ns[number] = time.time_ns()
        put(number, payload)

    def _listen(self, duration_s: float, result: Result) -> None:
        until_s = time.monotonic() + duration_s
        while (left_s := until_s - time.monotonic()) > 0.0 and select.select([self.port_in], [], [], left_s)[0]:
            datagram, ancillary, _, self.answering = self.port_in.recvmsg(512, 64)
            if len(datagram) < MAVLINK_HEADER + TARGET_AT + 1:
                continue
            payload = datagram[MAVLINK_HEADER:]
            number = payload[TARGET_AT]
            seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
            if datagram[0] == mavlink.PROTOCOL_MARKER_V2:
                self.commands[number] = complex(*struct.unpack_from("<ff", payload, VELOCITY_AT))
            asked_ns = self.asked_ns.pop(number, None)
            if asked_ns is not None:
                result.latencies_ms.append((seconds * 1_000_000_000 + nanoseconds - asked_ns) * 1e-6)

    @staticmethod
    def _heartbeat(number: int) -> bytes:
        sender = mavlink.MAVLink(None, number, mavlink.MAV_COMP_ID_AUTOPILOT1)
        message = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            mavlink.COPTER_MODE_GUIDED,
            mavlink.MAV_STATE_ACTIVE,
            3,
        )
        return bytes(message.pack(sender))


def cpu_s(pid: int) -> float:
    """Return the processor time a process has used, s."""
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    started = subprocess.Popen([sys.executable, *arguments])
    try:
        yield started
    finally:
        started.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            started.wait(3.0)
        started.kill()


def measure(who: str, count: int, endpoint: str, session: zenoh.Session, seconds: float) -> Result:
    """Start one of the three, and fly against it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port_in:
        port_in.bind(("127.0.0.1", 0))
        port_in.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        port_in.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
        probe = Probe(count, port_in)
        publishers = {n: _publisher(session, n) for n in probe.places}

        def put_on_bus(number: int, payload: bytes) -> None:
            publishers[number].put(payload)

        def put_on_wire(number: int, payload: bytes) -> None:
            port_in.sendto(bytes([number]) + payload, probe.answering)

        arguments = (__file__, who, endpoint, str(port_in.getsockname()[1]), str(count))
        with process(*arguments) as answering:
            _, _, _, probe.answering = port_in.recvmsg(512, 64)
            if who == "service":
                for _ in range(4):
                    probe.beat()
                    time.sleep(0.5)
            result = probe.fly(put_on_wire if who == "bare UDP" else put_on_bus, answering.pid, seconds)
            if (status := answering.poll()) is not None:
                raise RuntimeError(f"{who} ended with status {status} while it was measured")
            return result


def _publisher(session: zenoh.Session, number: int) -> zenoh.Publisher:
    return session.declare_publisher(
        KEYS.bearings(f"U{number}"),
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.INTERACTIVE_HIGH,
        express=True,
    )


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
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    met = False
    print(f"load before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(f"the feed alone: {take_us():.1f} us per report")
    print(f"{'':24}{'us/report':>10}{'core':>10}{'p50 ms':>9}{'p99 ms':>9}{'x zenoh':>9}{'unanswered':>13}")
    with process("-m", "drivers.bus.router", endpoint):
        time.sleep(2.0)
        with zenoh.open(BusEndpoint(endpoint).configuration()) as session:
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
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM} if role == "bare zenoh" else set())
        if role == "service":
            asyncio.run(serve(bus_endpoint, port, receivers))
        elif role == "bare zenoh":
            answer_from_zenoh(bus_endpoint, port, receivers)
        else:
            answer_from_udp(port)
    else:
        sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS, *map(int, sys.argv[2:])))
