"""Link nodes in network namespaces: a relay with waves, a node killed or cut off in mid-leg, its vehicles taken over.

Two sites are namespaces, each with a radio to the copters, a link to the service and a router of its own. Run as root:

    python -m tests.benchmarks.bench_nodes --vehicles 200 --waves 3 [--fault cut] [--speedup 0.5] [--json FILE]
    python -m tests.benchmarks.bench_nodes --vehicles 20 --command [--fault cut] [--json FILE]

With --command they are the commands `fly` and `link-node` that fly, by a plan of their own and in real time, as all
vehicles that a playbook names. Otherwise service and nodes are begun by themselves, with a plan of so many waves.
All durations are in the simulated time that everything shares; real time is that divided by --speedup.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from drivers.aoa.simulated import SensorSettings
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import ControlReply, ControlRequest, decode, encode
from drivers.bus.session import Bus
from drivers.simulation.launcher import ProcessGroup, process_group
from tests.benchmarks.nodes_field import AIR, joined, playbook_of

SITES: Final = {"north": 1, "south": 2}
PORT: Final = 7447
KEYS: Final = SwarmKeys("nodes")
WAITS_S: Final = 600.0
"""Of simulated time, for anything."""


def sh(command: str) -> None:
    subprocess.run(command.split(), check=True, capture_output=True)


@contextlib.contextmanager
def namespaces() -> Iterator[None]:
    """Two namespaces with a radio and a link each; gone with the block."""
    made: list[str] = []
    try:
        sh(f"ip addr add {AIR}/32 dev lo")
        made.append(f"ip addr del {AIR}/32 dev lo")
        for site, number in SITES.items():
            sh(f"ip netns add br-{site}")
            made.append(f"ip netns del br-{site}")
            for kind, network in (("air", 77), ("lan", 78)):
                sh(f"ip link add {kind}-{site} type veth peer name {kind} netns br-{site}")
                made.append(f"ip link del {kind}-{site}")
                sh(f"ip addr add 10.{network}.{number}.1/24 dev {kind}-{site}")
                sh(f"ip link set {kind}-{site} up")
                sh(f"ip -n br-{site} addr add 10.{network}.{number}.2/24 dev {kind}")
                sh(f"ip -n br-{site} link set {kind} up")
            sh(f"ip -n br-{site} link set lo up")
            sh(f"ip -n br-{site} route add {AIR}/32 via 10.77.{number}.1")
        yield
    finally:
        for command in reversed(made):
            subprocess.run(command.split(), check=False, capture_output=True)


class Bench:
    """The running whole. Times are simulated, s since it began."""

    def __init__(self, arguments: argparse.Namespace, folder: Path) -> None:
        self.arguments, self.folder = arguments, folder
        self.epoch_ns = time.time_ns()
        self.router = f"tcp/127.0.0.1:{PORT}"
        self.states: dict[str, str] = {}
        self.playbook = playbook_of(arguments.vehicles, self.router)
        self.results: dict[str, Any] = {"vehicles": arguments.vehicles, "fault": arguments.fault}

    def now_s(self) -> float:
        return (time.time_ns() - self.epoch_ns) * 1e-9 * self.arguments.speedup

    @property
    def told(self) -> dict[str, Any]:
        return {
            "vehicles": self.arguments.vehicles, "waves": self.arguments.waves, "speedup": self.arguments.speedup,
            "epoch_ns": self.epoch_ns, "router": self.router, "runs": str(self.folder / "runs"),
        }  # fmt: skip

    async def start(self, group: ProcessGroup, name: str, word: str, told: dict[str, Any], site: str = "") -> None:
        """Start a process of the field, in a site's namespace where one is named."""
        await self.begin(group, name, ["-m", "tests.benchmarks.nodes_field", word, json.dumps(told)], site)

    async def begin(self, group: ProcessGroup, name: str, arguments: list[str], site: str = "") -> None:
        """Start a Python process, in a site's namespace where one is named."""
        if site:
            script = (
                f"import os; os.execvp('ip', {['ip', 'netns', 'exec', f'br-{site}', sys.executable, *arguments]!r})"
            )
            arguments = ["-c", script]
        await group.start(name, arguments, environment={"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"})

    async def run(self, group: ProcessGroup) -> None:
        listens = [self.router, *(f"tcp/10.78.{number}.1:{PORT}" for number in SITES.values())]
        await self.start(group, "router", "router", {"endpoints": listens, "connect": []})
        for part in range(self.arguments.processes):
            told = {"of": self.arguments.processes, "part": part, "moving": str(self.folder / f"moving-{part}")}
            parameters = {
                "FS_GCS_ENABLE": 0,
                "GUID_TIMEOUT": 1.0,
                "SR0_EXT_STAT": 0,
                "SR0_POSITION": 0,
                "SR0_EXTRA1": 0,
                "SR0_EXTRA2": 0,
            }
            await self.start(group, f"copters-{part}", "copters", self.told | told | {"parameters": parameters})
        for site, number in SITES.items():
            up = {"endpoints": [self.router], "connect": [f"tcp/10.78.{number}.1:{PORT}"]}
            await self.start(group, f"router-{site}", "router", up, site)
        for site in SITES:
            if self.arguments.command:
                words = ["link-node", site, "--swarm", "nodes", "--connect", self.router]
                await self.begin(group, site, ["-m", "gcs.cli", *words], site)
            else:
                await self.start(group, site, "node", self.told | {"name": site, "connect": self.router}, site)
        async with joined(self.router) as bus:
            await group.start("sensors", ["-m", "drivers.aoa.simulated"], stdin=self.sensors())
            bus.subscribe(KEYS.progress, self.note)
            if self.arguments.command:
                await self.begin(group, "service", self.command())
            else:
                await self.start(group, "service", "fly", self.told)
            await self.relay(group, bus)
            if self.arguments.command:
                self.results["exit_status"] = await asyncio.wait_for(group.processes["service"].wait(), WAITS_S)

    def command(self) -> list[str]:
        """Return the words of the `fly` command, for the playbook in a file."""
        path = self.folder / "nodes.yaml"
        path.write_bytes(msgspec.json.encode(self.playbook.model_dump(mode="json", exclude_unset=True)))
        return ["-m", "gcs.cli", "fly", str(path), "--attended", "--runs-dir", str(self.folder / "runs")]

    def sensors(self) -> bytes:
        settings = SensorSettings(
            swarm="nodes", endpoint=self.router, receivers=list(self.playbook.receivers), beacons={},
            sigma_rad=math.radians(0.1), rate_hz=self.arguments.rate_hz, latency_s=0.05, drop_out=0.0, seed=1,
            speedup=self.arguments.speedup, epoch_ns=self.epoch_ns, parent_pid=os.getpid(),
        )  # fmt: skip
        return msgspec.json.encode(settings)

    def note(self, _key: str, payload: bytes) -> None:
        change = msgspec.json.decode(payload)
        self.states[change["receiver"]] = change["state"]

    async def relay(self, group: ProcessGroup, bus: Bus) -> None:
        """Wait for the wave, strike, and see what becomes of it."""
        flying = self.arguments.strike_wave_of
        on_north = {name for name, at in (self.playbook.vehicles or {}).items() if at.node == "north"}
        in_leg = lambda: [n for n, s in self.states.items() if s in ("LEG_1", "LEG_2")]  # noqa: E731 - said twice
        await self.until(group, lambda: len(in_leg()) >= flying and self.speeds(on_north), "the wave in flight")
        await asyncio.sleep(1.0 / self.arguments.speedup)
        moving = self.speeds(on_north)
        struck_s = self.now_s()
        self.strike(group)
        self.say(f"{self.arguments.fault}: north, with {len(moving)} of its {len(on_north)} vehicles moving")
        self.results |= {"on_node": len(on_north), "moving_when_struck": len(moving)}
        await self.until(group, lambda: not self.speeds(on_north) and not in_leg(), "everybody stopped")
        await asyncio.sleep(0.5 / self.arguments.speedup)
        self.results["stopped_after_s"] = round(self.last_moving_s(on_north) - struck_s, 2)
        self.results["fastest_at_strike_mps"] = max(moving.values(), default=0.0)
        self.say(f"all stopped {self.results['stopped_after_s']} s after")
        reply = await self.until_done(group, bus, "takeover", "north")
        asked_s = self.now_s()
        self.say(reply.message)
        await self.until(group, lambda: "south has taken over" in self.log("service"), "the take-over")
        self.results["taken_over_after_s"] = round(self.now_s() - asked_s, 2)
        if self.arguments.fault == "cut":
            sh("ip link set lan-north up")
        await self.until_done(group, bus, "resume", None)
        resumed_s = self.now_s()
        await self.until(group, self.formed, "the formation", bus)
        self.results["formed_after_resume_s"] = round(self.now_s() - resumed_s, 1)
        self.results["simulated_s"] = round(self.now_s(), 1)
        self.say("formed")

    def formed(self) -> bool:
        return sum(state == "PLACED" for state in self.states.values()) == len(self.playbook.receivers)

    def strike(self, group: ProcessGroup) -> None:
        if self.arguments.fault == "cut":
            sh("ip link set lan-north down")
        else:
            group.processes["north"].send_signal(signal.SIGKILL)

    def speeds(self, names: set[str]) -> dict[str, float]:
        """Who of these moves now, and how fast."""
        found: dict[str, float] = {}
        for part in range(self.arguments.processes):
            lines = (self.folder / f"moving-{part}").read_text().splitlines()[-3:-1]
            found |= json.loads(lines[-1])[1] if lines else {}
        return {name: speed for name, speed in found.items() if name in names}

    def last_moving_s(self, names: set[str]) -> float:
        latest_ns = self.epoch_ns
        for part in range(self.arguments.processes):
            for line in (self.folder / f"moving-{part}").read_text().splitlines()[:-1]:
                at_ns, moving = json.loads(line)
                if names & moving.keys():
                    latest_ns = max(latest_ns, at_ns)
        return (latest_ns - self.epoch_ns) * 1e-9

    async def until_done(self, group: ProcessGroup, bus: Bus, verb: Any, name: str | None) -> ControlReply:
        reply = ControlReply(ok=False, message="")

        def done() -> bool:
            return reply.ok

        deadline_s = self.now_s() + WAITS_S
        while not done():
            reply = await self.ask(bus, verb, name)
            assert self.now_s() < deadline_s, reply.message
            await asyncio.sleep(0.5)
        return reply

    async def until(self, group: ProcessGroup, condition: Callable[[], Any], what: str, bus: Bus | None = None) -> None:
        """Wait; held receivers are let go on when the operator would."""
        deadline_s, said_s = self.now_s() + WAITS_S, time.monotonic()
        while not condition():
            group.require_running("service")
            assert self.now_s() < deadline_s, f"no {what}: {self.states}"
            if time.monotonic() - said_s > 20.0:
                said_s = time.monotonic()
                counted = {state: list(self.states.values()).count(state) for state in set(self.states.values())}
                self.say(f"waiting for {what}: {counted}")
            if bus is not None and "waiting for the operator" in self.log("service").splitlines()[-1]:
                await self.go_on(bus)
            await asyncio.sleep(0.1)

    async def go_on(self, bus: Bus) -> None:
        """Have a relay that holds go on, and nodes taken over that were lost besides: the machine may be too slow."""
        for site in SITES:
            reply = await self.ask(bus, "takeover", site)
            if reply.ok:
                self.say(f"besides: {reply.message[:40]}...")
                self.results["lost_besides"] = self.results.get("lost_besides", 0) + 1
        if (await self.ask(bus, "resume", None)).ok:
            self.results["resumed_again"] = self.results.get("resumed_again", 0) + 1

    async def ask(self, bus: Bus, verb: Any, name: str | None) -> ControlReply:
        return decode(await bus.ask(KEYS.control, encode(ControlRequest(verb, name))), ControlReply)

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text(errors="replace") or " "

    def say(self, text: str) -> None:
        print(f"{self.now_s():7.1f} s  {text}", flush=True)


async def bench(arguments: argparse.Namespace, folder: Path) -> dict[str, Any]:
    print(f"folder {folder}")
    running = Bench(arguments, folder)
    async with process_group(folder) as group:
        await running.run(group)
    return running.results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--waves", type=int, default=3)
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--command", action="store_true", help="fly with the `fly` command, in real time")
    parser.add_argument("--rate-hz", type=float, default=5.0, help="of the sensors")
    parser.add_argument("--processes", type=int, default=2, help="of copters")
    parser.add_argument("--fault", choices=("kill", "cut"), default="kill")
    parser.add_argument("--folder")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if arguments.command and arguments.speedup != 1.0:
        parser.error("--command flies in real time: leave out --speedup")
    arguments.strike_wave_of = max(1, (arguments.vehicles - 2) // (8 if arguments.command else 2 * arguments.waves))
    folder = Path(arguments.folder or tempfile.mkdtemp(prefix="bench-nodes-"))
    folder.mkdir(parents=True, exist_ok=True)
    with namespaces():
        results = asyncio.run(bench(arguments, folder))
    print(json.dumps(results, indent=1))
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
