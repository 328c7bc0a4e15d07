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
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.aoa.simulated import SensorSettings
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import SensorFault, encode
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
PLAYBOOK = """\
playbook: 1
name: field
formation: {{kind: custom, slots: {{O1: [70, 60]}}}}
transmitters:
  L0: {{at: [0, 0]}}
  L1: {{at: [100, 0]}}
receivers:
  U1: {{start: [20, 30]}}
vehicles:
  L0: {{link: 'udpin:127.0.0.1:{L0}', system_id: 1}}
  L1: {{link: 'udpin:127.0.0.1:{L1}', system_id: 2}}
  U1: {{link: 'udpin:127.0.0.1:{U1}', system_id: 3}}
flight: {{altitude_m: 4, speed_mps: 4, give_up_s: 2, land_after: true}}
bus: {{router: '{bus}'}}
"""


class Wire(asyncio.DatagramProtocol):
    """A tap between one copter and the service: passes every datagram on and notes the velocities commanded."""

    def __init__(self, system_id: int, service: tuple[str, int]) -> None:
        self.system_id = system_id
        self.armed: bool | None = None
        """What the copter's last heartbeat said."""
        self.was_armed = False
        self.modes: list[tuple[float, int]] = []
        """(wall time, s; custom mode) of every heartbeat of the copter, when it was passed on."""
        self.kinematics: list[tuple[float, GeodeticPosition, float]] = []
        """(wall time, s; place; horizontal speed, m/s) as the copter told them."""
        self.attitudes: list[tuple[float, float]] = []
        """(roll, pitch), rad, as the copter told them; it has to be asked for them."""
        self.signed: dict[bool, Counter[bool]] = {True: Counter(), False: Counter()}
        """By whether the service sent them: how many frames were signed, and how many were not."""
        self.setpoints: list[float] = []
        """Wall time of every setpoint of whatever kind that the service sent, s."""
        self.velocities: list[tuple[float, float]] = []
        """(wall time, s; commanded horizontal speed, m/s) of every velocity setpoint the service sent."""
        self.service = service
        self._copter: tuple[str, int] | None = None
        self._splitter = FrameSplitter()
        self._codec = Codec()
        self._pilot = mavlink.MAVLink(None, 254, mavlink.MAV_COMP_ID_MISSIONPLANNER)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        self.port = transport.get_extra_info("sockname")[1]

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        from_service = addr == self.service
        if not from_service:
            self._copter = addr
        if self._copter is not None:
            self.transport.sendto(data, self._copter if from_service else self.service)
        for frame in self._splitter.datagram(data):
            message = self._codec.decode(frame)
            self.signed[from_service][bool(frame[2] & SIGNED)] += 1
            if message is not None and from_service:
                self._note_command(message)
            elif message is not None and message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
                self._note_telemetry(message)

    def command(self, *parameters: float, number: int = mavlink.MAV_CMD_DO_SET_MODE) -> None:
        """Send a command to the copter as a pilot's station beside the service: a mode, unless it is another one."""
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        message = mavlink.MAVLink_command_long_message(self.system_id, 1, number, 0, *padded)
        self.send(message.pack(self._pilot))

    def send(self, frame: bytes) -> None:
        """Send a frame to the copter beside the service."""
        assert self._copter is not None
        self.transport.sendto(frame, self._copter)

    def _note_command(self, message: Message) -> None:
        if message.get_type().startswith("SET_POSITION_TARGET"):
            self.setpoints.append(time.monotonic())
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            self.velocities.append((time.monotonic(), math.hypot(message.vx, message.vy)))

    def _note_telemetry(self, message: Message) -> None:
        if message.get_type() == "HEARTBEAT":
            self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self.was_armed = self.was_armed or self.armed
            self.modes.append((time.monotonic(), message.custom_mode))
        elif message.get_type() == "GLOBAL_POSITION_INT":
            place = GeodeticPosition(message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
            self.kinematics.append((time.monotonic(), place, math.hypot(message.vx, message.vy) * 0.01))
        elif message.get_type() == "ATTITUDE":
            self.attitudes.append((message.roll, message.pitch))

    def error_received(self, exc: Exception) -> None:
        """The service has gone: nothing to do."""


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
    path.write_text(PLAYBOOK.format(bus=endpoint, **ports))
    playbook = load_playbook(path)
    path.write_text(change(path.read_text()))
    time_now = SimulatedTime(1.0, time.time_ns())
    async with contextlib.AsyncExitStack() as stack:
        wires = {name: Wire(system_id, (HOST, ports[name])) for system_id, name in enumerate(ports, start=1)}
        for wire in wires.values():
            await _tap(stack, wire, 0 if sitl is None else sitl.port(wire.system_id))
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
        await asyncio.sleep(1.0)  # the router has to listen before the sensors look for it
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


async def _tap(stack: contextlib.AsyncExitStack, wire: Wire, port: int) -> None:
    """Put a tap where a vehicle speaks to; it is taken away with the stack."""
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: wire, local_addr=(HOST, port))
    stack.callback(transport.close)


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
