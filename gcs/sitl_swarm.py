"""A swarm of autopilots in their own simulators that outlives the command that started it, and the folder it is in.

In the folder, `sitl.json` says what runs, `playbook.yaml` flies it, and `vehicles/` has the log of each.
"""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from drivers.clock import SystemClock
from drivers.errors import SimulationError
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import open_link
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.detached import DetachedProcess, end, start_detached
from drivers.simulation.launcher import last_words
from drivers.simulation.sitl import SITLS, Sitl
from drivers.simulation.sitl_keeper import KeeperSettings, KeptSwarm
from drivers.simulation.sitl_readiness import missing, until_all_ready
from drivers.strict_json import read_json
from gcs.errors import ServiceError
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.simulated_vehicles import sitl_vehicles_of

HOST: Final = "127.0.0.1"
FIRST_PORT: Final = 14601
"""From here up, below the ports that the system hands out by itself: nobody takes them between `up` and `fly`."""
LAST_PORT: Final = 15600
_KEEPER_POLL_S: Final = 0.05
_NEW: Final = ".new"


@dataclass(frozen=True)
class SwarmFolder:
    """Where a swarm lives."""

    path: Path

    @property
    def playbook(self) -> Path:
        """The playbook that flies the swarm; it is there once all are ready."""
        return self.path / "playbook.yaml"

    @property
    def state(self) -> Path:
        """What says what runs."""
        return self.path / "sitl.json"

    @property
    def vehicles(self) -> Path:
        """The working directories and logs of the simulators."""
        return self.path.absolute() / "vehicles"

    @property
    def keeper_log(self) -> Path:
        """The log of the process that keeps them up."""
        return self.path / "keeper.log"

    def read(self) -> KeptSwarm | None:
        """Return what was started here; None where nothing was. ServiceError when the file is not readable."""
        try:
            return read_json(self.state.read_bytes(), KeptSwarm)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError) as error:
            raise ServiceError(
                f"{self.state} cannot be read: {error}. End its simulators by hand, delete it"
            ) from error

    def claim(self) -> None:
        """Make the folder ready for a new swarm. ServiceError when one is up in it, or it holds something else."""
        state = self.read()
        if state is not None and (state.keeper.runs or running(state)):
            raise ServiceError(
                f"{len(running(state))} simulators are up in {self.path} already: "
                f"bearing-relay sitl down --folder {self.path}"
            )
        files = {path.name for path in (self.playbook, self.state, self.vehicles, self.keeper_log)}
        try:
            if self.path.exists() and not {entry.name.removesuffix(_NEW) for entry in self.path.iterdir()} <= files:
                raise ServiceError(f"{self.path} holds other things: choose another --folder")
            shutil.rmtree(self.vehicles, ignore_errors=True)  # an autopilot reads what one before it left
            self.playbook.unlink(missing_ok=True)
            self.state.unlink(missing_ok=True)
            self.vehicles.mkdir(parents=True)
        except OSError as error:
            raise ServiceError(f"the folder {self.path} cannot be made: {error}. Choose --folder") from error


@dataclass
class Progress:
    """How far a swarm is that comes up."""

    vehicles: dict[str, Vehicle] = field(default_factory=dict)
    ready: set[str] = field(default_factory=set)

    @property
    def waiting(self) -> dict[str, str]:
        """The vehicles that are not ready, each with what it has not said yet."""
        return {name: missing(vehicle) for name, vehicle in self.vehicles.items() if name not in self.ready}


Show = Callable[[Progress], contextlib.AbstractAsyncContextManager[None]]
"""Puts the progress on a screen for as long as its block lasts."""


def running(state: KeptSwarm) -> list[str]:
    """Return the names of the vehicles whose simulators run."""
    return [name for name, vehicle in state.vehicles.items() if vehicle.process.runs]


async def bring_up(path: Path, autopilot: str, folder: SwarmFolder, show: Show) -> KeptSwarm:
    """Start a simulator for every UAV of a playbook and return when all can fly.

    Ended before that, by an error or from outside, it leaves none running. Raises ServiceError, DriverError, in groups.
    """
    playbook, sitl, progress = load_playbook(path), SITLS[autopilot], Progress()
    if playbook.vehicles is not None:
        raise ServiceError(f"{path} names its vehicles already: sitl up starts them itself, leave out 'vehicles'")
    if playbook.mavlink.signing is not None:
        raise ServiceError(f"{path}: simulators begin without a signing key: leave out mavlink.signing")
    sitl.find()
    folder.claim()
    async with _links(playbook, sitl) as vehicles, show(progress):
        draft = _draft(path, folder, vehicles)
        progress.vehicles = vehicles
        keeper = _start_keeper(playbook, autopilot, folder, vehicles)
        try:
            state = await _all_started(keeper, folder, len(vehicles))

            def require_running(name: str) -> None:
                if not state.vehicles[name].process.runs:
                    raise SimulationError(f"the process of {name} has ended: {_said(folder, name)}")

            await until_all_ready(sitl, vehicles, require_running, progress.ready.add)
            draft.replace(folder.playbook)
        except BaseException:
            end([keeper])
            take_down(folder)
            raise
    return state


def take_down(folder: SwarmFolder) -> list[str]:
    """End the simulators that run in a folder and return their names. SimulationError for those that would not end."""
    state = folder.read()
    if state is None:
        return []
    ended = running(state)
    left = end([state.keeper]) + end(vehicle.process for vehicle in state.vehicles.values())
    if left:
        pids = ", ".join(str(process.pid) for process in left)
        raise SimulationError(f"these simulators in {folder.path} would not end: process {pids}. End them by hand")
    folder.state.unlink(missing_ok=True)
    return ended


def _start_keeper(
    playbook: Playbook, autopilot: str, folder: SwarmFolder, vehicles: Mapping[str, Vehicle]
) -> DetachedProcess:
    sitl = SITLS[autopilot]
    starting = sitl_vehicles_of(playbook, vehicles, sitl)
    for vehicle in starting:  # what a simulator cannot fly is known before one is started
        sitl.command(sitl.find(), vehicle, folder.vehicles / vehicle.name)
    settings = KeeperSettings(autopilot, starting, str(folder.vehicles), str(folder.state.absolute()))
    arguments = ["-m", "drivers.simulation.sitl_keeper"]
    return start_detached(arguments, folder.keeper_log, msgspec.json.encode(settings))


async def _all_started(keeper: DetachedProcess, folder: SwarmFolder, vehicles: int) -> KeptSwarm:
    """Return what the keeper has written down once it has started every vehicle. SimulationError when it has ended."""
    while True:
        state = folder.read()
        if state is not None and len(state.vehicles) == vehicles:
            return state
        if not keeper.runs:
            raise SimulationError(last_words(folder.keeper_log))
        await asyncio.sleep(_KEEPER_POLL_S)


def _said(folder: SwarmFolder, name: str) -> str:
    log = folder.vehicles / f"{name}.log"
    return f"{last_words(log)} (its log is {log})"


@contextlib.asynccontextmanager
async def _links(playbook: Playbook, sitl: Sitl) -> AsyncIterator[dict[str, Vehicle]]:
    """Open a link for every UAV at the port that `fly` is going to use.

    It has to be the very same: PX4 answers the first port that spoke to it until it is started anew.
    """
    clock, next_port = SystemClock(), FIRST_PORT
    async with contextlib.AsyncExitStack() as stack:
        vehicles: dict[str, Vehicle] = {}
        for system_id, name in enumerate(playbook.uavs, start=1):
            if (port := sitl.port(system_id)) == 0:
                port = _free_port(next_port)
                next_port = port + 1
            codec = Codec(playbook.mavlink.system_id)
            link = await stack.enter_async_context(open_link(LinkAddress("udpin", HOST, port), codec, clock))
            vehicles[name] = Vehicle(name, system_id, link, clock)
        yield vehicles


def _free_port(first: int) -> int:
    """Return the first UDP port from here up that is free. ServiceError when none is."""
    for port in range(first, LAST_PORT):
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((HOST, port))
            return port
    raise ServiceError(f"no UDP port from {first} to {LAST_PORT} is free")


def _draft(path: Path, folder: SwarmFolder, vehicles: Mapping[str, Vehicle]) -> Path:
    """Write a playbook with the links of its vehicles beside where it will be. PlaybookError when it would be none."""
    yaml = YAML(typ="rt")
    yaml.width = 120
    document = yaml.load(path.read_text(encoding="utf-8"))
    document["target"] = "vehicles"
    document["vehicles"] = CommentedMap()
    for name, vehicle in vehicles.items():
        document["vehicles"][name] = CommentedMap(link=str(vehicle.link.address), system_id=vehicle.system_id)
        document["vehicles"][name].fa.set_flow_style()
    document.setdefault("sensor", CommentedMap())["simulated"] = True
    draft = folder.path / (folder.playbook.name + _NEW)
    with draft.open("w", encoding="utf-8") as file:
        yaml.dump(document, file)
    load_playbook(draft)
    return draft
