"""Two link nodes and a service as processes, four embedded copters behind taps: everything real but the aircraft."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import sys
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from drivers.aoa.simulated import SensorSettings
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import ControlReply, ControlRequest, decode, encode
from drivers.bus.session import Bus, BusEndpoint, open_bus
from drivers.simulation.launcher import CopterSpec, ProcessGroup, SimulatedTime, free_tcp_port, process_group
from gcs.playbook.loader import load_playbook
from gcs.simulated_vehicles import homes_of
from tests.gcs.field import free_udp_port
from tests.gcs.nodes.tap import HOST, Tap

LINK_NODE = "import typer; from gcs.commands.link_node import link_node; typer.run(link_node)"
NODE_OF = {"L0": "north", "L1": "south", "U1": "north", "U2": "south"}
PLAYBOOK = """\
playbook: 1
name: sites
formation: {{kind: custom, slots: {{O1: [70, 60], O2: [20, 80]}}}}
transmitters:
  L0: {{at: [0, 0]}}
  L1: {{at: [100, 0]}}
receivers:
  U1: {{start: [30, 20]}}
  U2: {{start: [10, 40]}}
vehicles:
  L0: {{link: 'udpin:127.0.0.1:{L0}', system_id: 1, node: north}}
  L1: {{link: 'udpin:127.0.0.1:{L1}', system_id: 2, node: south}}
  U1: {{link: 'udpin:127.0.0.1:{U1}', system_id: 3, node: north}}
  U2: {{link: 'udpin:127.0.0.1:{U2}', system_id: 4, node: south}}
planner: {{method: paper}}
flight: {{altitude_m: 4, speed_mps: 4, give_up_s: 10}}
bus: {{router: '{bus}'}}
"""


@dataclass
class Sites:
    """The running whole."""

    group: ProcessGroup
    taps: dict[str, Tap]
    bus: Bus
    folder: Path
    progress: list[tuple[str, str]] = field(default_factory=list)
    """(receiver, state) of every change, in order."""
    lines: list[str] = field(default_factory=list)
    service: asyncio.subprocess.Process = field(init=False)
    _reader: asyncio.Task[None] = field(init=False)

    async def start(self, *words: str) -> None:
        """Start a service."""
        self.service = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "gcs.cli", *words),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        self._reader = asyncio.create_task(_read_lines(self.service, self.lines))

    async def kill(self) -> None:
        """End the service as a crash does."""
        with contextlib.suppress(ProcessLookupError):
            self.service.kill()
        await self.service.wait()
        await self._reader

    async def until(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline_s, "\n".join([f"no {what} in time; the service said:", *self.lines])
            assert self.service.returncode is None, "\n".join(["the service ended:", *self.lines])
            await asyncio.sleep(0.02)

    async def speak(self, verb: Any, name: str | None = None) -> ControlReply:
        return decode(await self.bus.ask(SwarmKeys("sites").control, encode(ControlRequest(verb, name))), ControlReply)

    async def until_done(self, verb: Any, name: str | None, timeout_s: float) -> None:
        """Say a word until it is done."""
        deadline_s = time.monotonic() + timeout_s
        while not (reply := await self.speak(verb, name)).ok:
            assert time.monotonic() < deadline_s, "\n".join([reply.message, *self.lines])
            await asyncio.sleep(0.2)

    def state(self, receiver: str) -> str:
        return next((state for name, state in reversed(self.progress) if name == receiver), "WAITING")

    def said(self) -> str:
        return " ".join(" ".join(self.lines).split())


@contextlib.asynccontextmanager
async def open_sites(folder: Path) -> AsyncIterator[Sites]:
    """Open them, and fly attended; everything ends with the block."""
    ports = {name: free_udp_port() for name in NODE_OF}
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    path = folder / "sites.yaml"
    path.write_text(PLAYBOOK.format(bus=endpoint, **ports))
    playbook, time_now = load_playbook(path), SimulatedTime(1.0, time.time_ns())
    async with contextlib.AsyncExitStack() as stack:
        taps = {name: Tap(system_id, ports[name]) for system_id, name in enumerate(ports, start=1)}
        for tap in taps.values():
            await _tap(stack, tap)
        group = await stack.enter_async_context(process_group(folder))
        await group.start("router", ["-m", "drivers.bus.router", endpoint, "--parent-pid", str(os.getpid())])
        bus = await stack.enter_async_context(_joined(endpoint))
        for name, home in homes_of(playbook).items():
            copter = CopterSpec(name, taps[name].system_id, taps[name].port, home)
            await group.start(name, copter.arguments(time_now, os.getpid()))
        for node in ("north", "south"):
            await group.start(node, ["-c", LINK_NODE, node, "--swarm", "sites", "--connect", endpoint])
        settings = SensorSettings(
            swarm="sites", endpoint=endpoint, receivers=["U1", "U2"], beacons={}, sigma_rad=math.radians(0.1),
            rate_hz=10.0, latency_s=0.05, drop_out=0.0, seed=1, speedup=1.0, epoch_ns=time_now.epoch_ns,
            parent_pid=os.getpid(),
        )  # fmt: skip
        await group.start("sensors", ["-m", "drivers.aoa.simulated"], stdin=msgspec.json.encode(settings))
        sites = Sites(group, taps, bus, folder)
        bus.subscribe(SwarmKeys("sites").progress, lambda _, payload: _note(sites.progress, payload))
        await sites.start("fly", str(path), "--runs-dir", str(folder / "runs"), "--attended")
        try:
            yield sites
        finally:
            await sites.kill()


async def _tap(stack: contextlib.AsyncExitStack, tap: Tap) -> None:
    """Put a tap between a copter and its link; it is taken away with the stack."""
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: tap, local_addr=(HOST, 0))
    stack.callback(transport.close)


@contextlib.asynccontextmanager
async def _joined(endpoint: str) -> AsyncIterator[Bus]:
    async with contextlib.AsyncExitStack() as stack:
        for attempt in range(100):
            with contextlib.suppress(Exception if attempt < 99 else ()):
                yield await stack.enter_async_context(open_bus(BusEndpoint(endpoint)))
                return
            await asyncio.sleep(0.1)


def _note(progress: list[tuple[str, str]], payload: bytes) -> None:
    change = msgspec.json.decode(payload)
    progress.append((change["receiver"], change["state"]))


async def _read_lines(process: asyncio.subprocess.Process, lines: list[str]) -> None:
    assert process.stdout is not None
    while line := await process.stdout.readline():
        lines.append(line.decode().rstrip())
