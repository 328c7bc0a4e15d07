"""Who answers a benchmark's swarm, each in its own process: a service's own chain, and bare transports beside it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import zenoh

from drivers.bus.certificates import Authority, now
from drivers.bus.keys import uav_of
from drivers.bus.messages import PositionReport, encode
from drivers.bus.security import ROUTER, SERVICE, configurations, with_keys
from drivers.bus.session import Bus, BusEndpoint, LiveBus, open_bus
from drivers.clock import SystemClock
from drivers.mavlink.autopilots import autopilot_of
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import Link, open_link
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Kinematics, Vehicle
from drivers.simulation.launcher import free_tcp_port
from drivers.tasks import StartTask, open_background
from gcs.bearings import BearingFeed, Observations
from gcs.clock_offsets import ClockOffsets
from gcs.relay.leg_flight import LegFlight
from gcs.relay.records import ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.stop_monitor import StopMonitor
from planner.frames import SiteFrame
from planner.plan import Leg, Route
from tests.benchmarks.swarm import ALTITUDE_M, FRAME, KEYS, ORIGIN, a_setpoint

SETTINGS: Final = RelaySettings()
_ROUTER_STARTS_S: Final = 10.0


@dataclass(frozen=True)
class Station:
    """A service that hears its vehicles, and flies none of them yet."""

    bus: LiveBus
    link: Link
    clock: SystemClock
    feed: BearingFeed
    streams: dict[str, SetpointStreamer]
    start: StartTask

    def flight(self, name: str, leg: Leg, monitor: StopMonitor, observations: Observations) -> LegFlight:
        """Return a leg as the relay flies it."""
        return LegFlight(
            ReceiverRecord(Route(name, "O", 1, 1, "I", leg.start, leg.end, (leg,))),
            monitor,
            self.streams[name],
            observations,
            objection=lambda: None,
            announce=lambda record: None,
            frame=FRAME,
            clock=self.clock,
            settings=SETTINGS,
        )


@contextlib.asynccontextmanager
async def open_station(
    endpoint: str, address: LinkAddress, count: int, limits: StreamLimits, keys: Path | None = None
) -> AsyncIterator[Station]:
    """Join the bus and speak to `count` vehicles behind one link; return when all of them have been heard."""
    clock = SystemClock()
    names = {f"U{number}": number for number in range(1, count + 1)}
    clocks = ClockOffsets(names, clock)
    feed = BearingFeed(names, FRAME, clock, SETTINGS.gap_s, clocks)
    async with (
        open_bus(with_keys(BusEndpoint(endpoint), keys)) as bus,
        open_link(address, Codec(), clock) as link,
        open_background() as start,
    ):
        vehicles = {name: Vehicle(name, number, link, clock) for name, number in names.items()}
        for vehicle in vehicles.values():
            await vehicle.wait_until(lambda v=vehicle: v.telemetry.heartbeat is not None, 20.0, "heartbeat", "")
            vehicle.on_kinematics.append(_position_publisher(bus, vehicle.name, clock))
        clocks.attach(bus, KEYS)
        feed.attach(bus, KEYS)
        start(clocks.run())
        streams = {
            name: SetpointStreamer(vehicle, autopilot_of(vehicle), ALTITUDE_M, limits, clock)
            for name, vehicle in vehicles.items()
        }
        for stream in streams.values():
            start(stream.run())
        yield Station(bus, link, clock, feed, streams, start)


def _position_publisher(bus: Bus, name: str, clock: SystemClock) -> Callable[[Kinematics], None]:
    """Return what tells the bus where a vehicle is, as a run does."""
    site = SiteFrame(ORIGIN)

    def publish(kinematics: Kinematics) -> None:
        north_east, down_m = site.from_geodetic(kinematics.position)
        north_mps, east_mps, _ = kinematics.velocity_ned_mps
        report = PositionReport(clock.unix_ns(), north_east.real, north_east.imag, down_m, north_mps, east_mps)
        bus.put_latest(KEYS.position(name), encode(report))

    return publish


def to_port(port: int) -> LinkAddress:
    """Return the link to vehicles that listen on one UDP port of this machine."""
    return LinkAddress("udpout", "127.0.0.1", port)


async def until_terminated() -> None:
    """Return when the process is told to end."""
    stopped = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stopped.set)
    await stopped.wait()


def answer_from_zenoh(endpoint: str, port: int, *key_expressions: str, keys: Path | None = None) -> None:
    """Answer every report on some keys straight from the zenoh callback, until told to end."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    answers = {f"U{number}": a_setpoint(number) for number in range(256)}
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect(("127.0.0.1", port))

    def answer(sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()
        sender.send(answers[uav_of(str(sample.key_expr)) or ""])

    with zenoh.open(with_keys(BusEndpoint(endpoint), keys).configuration()) as session:
        for key_expression in key_expressions:
            session.declare_subscriber(key_expression, answer)
        sender.send(b"here")
        signal.sigwait({signal.SIGTERM})


def answer_from_udp(port: int) -> None:
    """Answer every datagram: its first byte says whose it is."""
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect(("127.0.0.1", port))
    sender.send(b"here")
    while True:
        sender.send(a_setpoint(sender.recv(2048)[0]))


@contextlib.contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run Python beside the block."""
    started = subprocess.Popen([sys.executable, *arguments])
    try:
        yield started
    finally:
        started.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            started.wait(3.0)
        started.kill()


@contextlib.contextmanager
def router() -> Iterator[tuple[str, int]]:
    """Run a bus router beside the block; yield its endpoint and its process id."""
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    with process("-m", "drivers.bus.router", endpoint) as started:
        _wait_for(BusEndpoint(endpoint))
        yield endpoint, started.pid


@contextlib.contextmanager
def closed_router(uavs: Collection[str]) -> Iterator[tuple[str, int, Path]]:
    """Run a router that is closed to strangers; yield besides the file of the service's keys."""
    endpoint = f"tls/127.0.0.1:{free_tcp_port()}"
    with tempfile.TemporaryDirectory() as folder:
        made = configurations(KEYS.swarm, uavs, endpoint, Authority(KEYS.swarm, now(), valid_days=1))
        files = {party: Path(folder) / f"{party}.json5" for party in (ROUTER, SERVICE)}
        for party, file in files.items():
            file.touch(mode=0o600)
            file.write_text(made[party], encoding="utf-8")
        with process("-m", "drivers.bus.router", endpoint, "--keys", str(files[ROUTER])) as started:
            _wait_for(with_keys(BusEndpoint(endpoint), files[SERVICE]))
            yield endpoint, started.pid, files[SERVICE]


def _wait_for(endpoint: BusEndpoint) -> None:
    until_s = time.monotonic() + _ROUTER_STARTS_S
    while True:
        try:
            zenoh.open(endpoint.configuration()).close()
            return
        except zenoh.ZError:
            if time.monotonic() > until_s:
                raise
            time.sleep(0.1)


def cpu_s(pid: int) -> float:
    """Return the processor time a process has used, s."""
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def held_by(pid: int) -> dict[str, float]:
    """Return the memory, descriptors and threads of a process."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    fields = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    return {
        "memory MB": int(fields["VmRSS"].split()[0]) / 1024.0,
        "descriptors": float(len(list(Path(f"/proc/{pid}/fd").iterdir()))),
        "threads": float(fields["Threads"]),
    }
