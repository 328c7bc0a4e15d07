"""Keeps a swarm of autopilots' simulators up: `python -m drivers.simulation.sitl_keeper`, told what on standard input.

It is the parent they need (ArduCopter's simulator ends with the process that started it) and outlives the command that
started it. What it writes down is enough to find it, and each of them, again.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import msgspec

from drivers.errors import SimulationError
from drivers.process import until_told_to_stop
from drivers.simulation.detached import DetachedProcess
from drivers.simulation.launcher import process_group, this_pid
from drivers.simulation.sitl import SITLS, SitlVehicle


class KeeperSettings(msgspec.Struct, frozen=True):
    """What the keeper is told: whose simulators of which vehicles, where they work, and where to write it down."""

    autopilot: str
    vehicles: list[SitlVehicle]
    work_dir: str
    state_file: str


class KeptVehicle(msgspec.Struct, frozen=True):
    """One vehicle that was started: the port it speaks to, and its process."""

    system_id: int
    port: int
    process: DetachedProcess


class KeptSwarm(msgspec.Struct, frozen=True):
    """What the state file says: the autopilot, the keeper, and the vehicles started so far by their names."""

    autopilot: str
    keeper: DetachedProcess
    vehicles: dict[str, KeptVehicle]

    def write(self, path: Path) -> None:
        """Write it down at once and as a whole."""
        new = path.with_name(f"{path.name}.new")
        new.write_bytes(msgspec.json.format(msgspec.json.encode(self), indent=1) + b"\n")
        new.replace(path)


async def keep(settings: KeeperSettings) -> None:
    """Start the simulators, each written down before the next, and end them when told to stop."""
    async with _started(settings):
        await until_told_to_stop()


@contextlib.asynccontextmanager
async def _started(settings: KeeperSettings) -> AsyncIterator[None]:
    state_file, sitl = Path(settings.state_file), SITLS[settings.autopilot]
    swarm = KeptSwarm(settings.autopilot, DetachedProcess.of(this_pid()), {})
    swarm.write(state_file)
    async with process_group(Path(settings.work_dir)) as group:
        for vehicle in settings.vehicles:
            await sitl.start(vehicle, group)
            process = DetachedProcess.of(group.processes[vehicle.name].pid)
            swarm.vehicles[vehicle.name] = KeptVehicle(vehicle.system_id, vehicle.port, process)
            swarm.write(state_file)
        yield


def main() -> None:
    """Keep what standard input says; what goes wrong is one line on standard error."""
    try:
        asyncio.run(keep(msgspec.json.decode(sys.stdin.buffer.read(), type=KeeperSettings)))
    except (SimulationError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
