"""A field in miniature for faults: the real command against three copters, with a tap on the wire to each of them.

Everything is a process of its own and runs in real time: the bus router, the sensors, the copters and the service. The
service attaches to them by links in its playbook, as it would to vehicles it did not start.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import os
import signal
import socket
import struct
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.aoa.simulated import SensorSettings
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import ControlReply, ControlRequest, SensorFault, decode, encode
from drivers.bus.session import BusEndpoint, open_bus
from drivers.clock import SystemClock
from drivers.mavlink.codec import Codec, FrameSplitter, Message
from drivers.mavlink.link import open_link
from drivers.mavlink.signing import SIGNED
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import CopterSpec, ProcessGroup, SimulatedTime, free_tcp_port, process_group
from drivers.simulation.sitl import Sitl, SitlVehicle
from drivers.simulation.sitl_readiness import until_all_ready
from drivers.simulation.weather import CALM, SimulatedWeather
from gcs.playbook.loader import load_playbook
from gcs.simulated_vehicles import homes_of
from planner.frames import GeodeticPosition

HOST = "127.0.0.1"
SO_TIMESTAMPNS = 35
"""Linux: each datagram is told with when it came, by the clock of time.time()."""
PLAYBOOK = """\
playbook: 1
name: field
formation: {{kind: custom, slots: {{O1: [70, 60]}}}}
transmitters:
  L0: {{at: [0, 0]}}
  L1: {{at: [100, 0]}}
receivers:
  U1: {{start: {start}}}
vehicles:
  L0: {{link: 'udpin:127.0.0.1:{L0}', system_id: 1}}
  L1: {{link: 'udpin:127.0.0.1:{L1}', system_id: 2}}
  U1: {{link: 'udpin:127.0.0.1:{U1}', system_id: 3}}
flight: {{altitude_m: {altitude_m}, speed_mps: 4, give_up_s: 2, land_after: true}}
bus: {{router: '{bus}'}}
"""
NEAR = {"start": "[60, 40]", "altitude_m": 2}
"""Two legs of some seconds each, and not much of a climb: all of it is waited for."""
FAR = {"start": "[20, 30]", "altitude_m": 4}
"""For real autopilots, which are looked at when they are at speed in their second leg."""


class Wire:
    """A tap between one copter and the service: passes every datagram on and notes the velocities commanded.

    Times are monotonic, s, and the kernel's: of when a datagram was sent here, however late it is looked at.
    """

    def __init__(self, system_id: int, service: tuple[str, int]) -> None:
        self.system_id = system_id
        self.armed: bool | None = None
        """What the copter's last heartbeat said."""
        self.was_armed = False
        self.modes: list[tuple[float, int]] = []
        """(time, s; custom mode) of every heartbeat of the copter, when it was passed on to the service."""
        self.kinematics: list[tuple[float, GeodeticPosition, float]] = []
        """(time, s; place; horizontal speed, m/s) as the copter told them."""
        self.attitudes: list[tuple[float, float]] = []
        """(roll, pitch), rad, as the copter told them; it has to be asked for them."""
        self.signed: dict[bool, Counter[bool]] = {True: Counter(), False: Counter()}
        """By whether the service sent them: how many frames were signed, and how many were not."""
        self.setpoints: list[float] = []
        """Time of every setpoint of whatever kind that the service sent, s."""
        self.velocities: list[tuple[float, float]] = []
        """(time, s; commanded horizontal speed, m/s) of every velocity setpoint the service sent."""
        self.service = service
        self._copter: tuple[str, int] | None = None
        self._splitter = FrameSplitter()
        self._codec = Codec()
        self._pilot = mavlink.MAVLink(None, 254, mavlink.MAV_COMP_ID_MISSIONPLANNER)

    @contextlib.contextmanager
    def tapped(self, port: int) -> Iterator[None]:
        """Be where the vehicle speaks to, a port or 0 for any that is free, as long as the block lasts."""
        loop = asyncio.get_running_loop()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as self._socket:
            self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            self._socket.bind((HOST, port))
            self.port = self._socket.getsockname()[1]
            loop.add_reader(self._socket, self._read)
            try:
                yield
            finally:
                loop.remove_reader(self._socket)

    def _read(self) -> None:
        """Take all that has come."""
        while True:
            try:
                data, ((_, _, stamp), *_), _, source = self._socket.recvmsg(2048, socket.CMSG_SPACE(16))
            except BlockingIOError:
                return
            except OSError:  # the service has gone: what was sent to it comes back as an error
                continue
            seconds, nanoseconds = struct.unpack("@qq", stamp)
            self._take(data, source, time.monotonic() - time.time() + seconds + nanoseconds * 1e-9)

    def _take(self, data: bytes, source: tuple[str, int], at_s: float) -> None:
        from_service = source == self.service
        if not from_service:
            self._copter = source
        if self._copter is not None:
            self._pass_on(data, self._copter if from_service else self.service)
        for frame in self._splitter.datagram(data):
            message = self._codec.decode(frame)
            self.signed[from_service][bool(frame[2] & SIGNED)] += 1
            if message is not None and from_service:
                self._note_command(message, at_s)
            elif message is not None and message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
                self._note_telemetry(message, at_s)

    def _pass_on(self, data: bytes, address: tuple[str, int]) -> None:
        with contextlib.suppress(OSError):  # nobody is there
            self._socket.sendto(data, address)

    def command(self, *parameters: float, number: int = mavlink.MAV_CMD_DO_SET_MODE) -> None:
        """Send a command to the copter as a pilot's station beside the service: a mode, unless it is another one."""
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        message = mavlink.MAVLink_command_long_message(self.system_id, 1, number, 0, *padded)
        self.send(message.pack(self._pilot))

    def send(self, frame: bytes) -> None:
        """Send a frame to the copter beside the service."""
        assert self._copter is not None
        self._pass_on(frame, self._copter)

    def _note_command(self, message: Message, at_s: float) -> None:
        if message.get_type().startswith("SET_POSITION_TARGET"):
            self.setpoints.append(at_s)
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            self.velocities.append((at_s, math.hypot(message.vx, message.vy)))

    def _note_telemetry(self, message: Message, at_s: float) -> None:
        if message.get_type() == "HEARTBEAT":
            self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self.was_armed = self.was_armed or self.armed
            self.modes.append((time.monotonic(), message.custom_mode))
        elif message.get_type() == "GLOBAL_POSITION_INT":
            place = GeodeticPosition(message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
            self.kinematics.append((at_s, place, math.hypot(message.vx, message.vy) * 0.01))
        elif message.get_type() == "ATTITUDE":
            self.attitudes.append((message.roll, message.pitch))


@dataclass
class Field:
    """The running field."""

    group: ProcessGroup
    wires: dict[str, Wire]
    """The taps, by the names of the vehicles."""
    endpoint: str
    service: asyncio.subprocess.Process
    runs_dir: Path
    playbook: Path
    lines: list[str] = field(default_factory=list)

    @property
    def wire(self) -> Wire:
        """The tap on the wire to the receiver."""
        return self.wires["U1"]

    async def until(self, condition: Callable[[], bool], timeout_s: float) -> None:
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline_s, "\n".join(["not in time; the service said:", *self.lines])
            assert self.service.returncode is None, "\n".join(["the service ended:", *self.lines])
            await asyncio.sleep(0.02)

    async def until_moving(self) -> None:
        """Return when the receiver is under way at speed."""
        await self.until(lambda: bool(self.wire.velocities) and self.wire.velocities[-1][1] > 2.0, 60.0)

    async def until_waiting(self, for_words: str) -> None:
        """Return when the relay is held and the service waits for the operator, who is told which words to type."""
        await self.until(lambda: f"waiting for the operator: bearing-relay control {for_words}" in self.said(), 20.0)

    async def say(self, verb: str, vehicle: str | None = None) -> ControlReply:
        """Say a control word over the bus, as the command does; return the answer."""
        async with open_bus(BusEndpoint(self.endpoint)) as bus:
            payload = await bus.ask(SwarmKeys("field").control, encode(ControlRequest(verb, vehicle)))
        return decode(payload, ControlReply)

    async def control(self, *words: str) -> tuple[int, str]:
        """Type a control command; return its exit status and what it says."""
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "gcs.cli", "control", *words, "--runs-dir", str(self.runs_dir)),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        said, _ = await process.communicate()
        assert process.returncode is not None
        return process.returncode, said.decode()

    async def ended(self, timeout_s: float = 20.0) -> int:
        """Return the service's exit status."""
        await asyncio.wait_for(self.service.wait(), timeout_s)
        await asyncio.sleep(0.1)
        assert self.service.returncode is not None
        return self.service.returncode

    def signal(self, name: str, number: signal.Signals) -> None:
        self.group.processes[name].send_signal(number)

    async def silence(self, receiver: str) -> None:
        async with open_bus(BusEndpoint(self.endpoint)) as bus:
            bus.put_reliably(SwarmKeys("field").sensor_fault(receiver), encode(SensorFault(silent=True)))
            await asyncio.sleep(0.2)

    def fastest_after(self, time_s: float) -> float:
        """The fastest velocity commanded after a (monotonic) time, m/s; 0 when none was."""
        return max((speed for at, speed in self.wire.velocities if at > time_s), default=0.0)

    def said(self) -> str:
        return " ".join(" ".join(self.lines).split())

    def report(self) -> dict:
        return json.loads(next(self.runs_dir.glob("*/report.json")).read_text())


@contextlib.asynccontextmanager
async def open_field(
    folder: Path,
    sitl: Sitl | None = None,
    options: tuple[str, ...] = (),
    change: Callable[[str], str] = str,
    weather: SimulatedWeather = CALM,
    before: Callable[[dict[str, Wire]], Awaitable[None]] | None = None,
    absent: Collection[str] = (),
) -> AsyncIterator[Field]:
    """Open the field, on embedded copters or a real autopilot, and fly; everything in it ends with the block.

    `change` is done to the playbook that the service flies by, `before` with the taps before it does; vehicles `absent`
    are never started.
    """
    ports = {name: free_udp_port() for name in ("L0", "L1", "U1")}
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    path = folder / "field.yaml"
    path.write_text(PLAYBOOK.format(bus=endpoint, **ports, **(NEAR if sitl is None else FAR)))
    playbook = load_playbook(path)
    path.write_text(change(path.read_text()))
    time_now = SimulatedTime(1.0, time.time_ns())
    async with contextlib.AsyncExitStack() as stack:
        wires = {name: Wire(system_id, (HOST, ports[name])) for system_id, name in enumerate(ports, start=1)}
        for wire in wires.values():
            stack.enter_context(wire.tapped(0 if sitl is None else sitl.port(wire.system_id)))
        group = await stack.enter_async_context(process_group(folder))
        await group.start("router", ["-m", "drivers.bus.router", endpoint, "--parent-pid", str(os.getpid())])
        for name, home in homes_of(playbook).items():
            if name in absent:
                continue
            system_id, port = wires[name].system_id, wires[name].port
            if sitl is None:
                copter = CopterSpec(name, system_id, port, home, weather=weather)
                await group.start(name, copter.arguments(time_now, os.getpid()))
            else:
                await sitl.start(SitlVehicle(name, system_id, port, home, weather, speedup=sitl.start_speedup), group)
        settings = SensorSettings(
            swarm="field", endpoint=endpoint, receivers=["U1"], beacons={}, sigma_rad=math.radians(0.1), rate_hz=10.0,
            latency_s=0.1, drop_out=0.0, seed=1, speedup=1.0, epoch_ns=time_now.epoch_ns, parent_pid=os.getpid(),
        )  # fmt: skip
        await _listening(endpoint)  # before the sensors look for it
        await group.start("sensors", ["-m", "drivers.aoa.simulated"], stdin=msgspec.json.encode(settings))
        if sitl is not None:
            await _made_ready(sitl, wires, group)
        if before is not None:
            await before(wires)
        service = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "gcs.cli", "fly", str(path), "--runs-dir", str(folder / "runs"), *options),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        running = Field(group, wires, endpoint, service, folder / "runs", path)
        reader = asyncio.create_task(_read_lines(service, running.lines))
        try:
            yield running
        finally:
            with contextlib.suppress(ProcessLookupError):
                service.kill()
            await service.wait()
            await reader


async def _listening(endpoint: str) -> None:
    """Wait until somebody listens at a TCP endpoint of the bus."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    async with asyncio.timeout(20.0):
        while True:
            with contextlib.suppress(OSError):
                _, writer = await asyncio.open_connection(host, int(port))
                writer.close()
                return
            await asyncio.sleep(0.02)


async def _made_ready(sitl: Sitl, wires: dict[str, Wire], group: ProcessGroup) -> None:
    """Wait, in the place of the service, until real autopilots can fly."""
    async with contextlib.AsyncExitStack() as stack:
        clock, vehicles = SystemClock(), {}
        for name, wire in wires.items():
            link = await stack.enter_async_context(open_link(LinkAddress("udpin", *wire.service), Codec(), clock))
            vehicles[name] = Vehicle(name, wire.system_id, link, clock)
        await until_all_ready(sitl, vehicles, group.require_running)


async def _read_lines(process: asyncio.subprocess.Process, lines: list[str]) -> None:
    assert process.stdout is not None
    while line := await process.stdout.readline():
        lines.append(line.decode().rstrip())


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])
