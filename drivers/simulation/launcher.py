"""Starts the processes of a simulated run (copters, sensors, bus router) and ends exactly those."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from drivers.errors import SimulationError
from drivers.simulation.weather import CALM, SimulatedWeather, copter_parameters
from planner.frames import GeodeticPosition

_END_TIMEOUT_S = 2.0
_SILENT_UNTIL_ASKED = ("SR0_EXT_STAT=0", "SR0_POSITION=0", "SR0_EXTRA1=0", "SR0_EXTRA2=0", "SR0_EXTRA3=0")
"""Stream rates of a copter in a fleet: the service asks for what it uses."""


@dataclass(frozen=True)
class SimulatedTime:
    """The time all processes of a run share."""

    speedup: float
    epoch_ns: int

    def arguments(self) -> list[str]:
        """Return it as command line arguments."""
        return ["--speedup", f"{self.speedup:g}", "--epoch-ns", str(self.epoch_ns)]


@dataclass(frozen=True)
class CopterSpec:
    """One embedded copter: who it is, where it starts, and the UDP port of the link it speaks to."""

    name: str
    system_id: int
    port: int
    home: GeodeticPosition
    heading_deg: float = 0.0
    weather: SimulatedWeather = CALM
    station_id: int = 255
    """The system id of the station whose heartbeats its failsafe counts."""

    def arguments(self, time: SimulatedTime, parent_pid: int) -> list[str]:
        """Return the command line of its process, after the interpreter. SimulationError for weather it has not."""
        at = self.home
        home = f"{at.latitude_deg:.9f},{at.longitude_deg:.9f},{at.altitude_m:.3f},{self.heading_deg:g}"
        told = {"SYSID_MYGCS": self.station_id, **copter_parameters(self.weather)}
        parameters = (*_SILENT_UNTIL_ASKED, *(f"{name}={value:g}" for name, value in told.items()))
        return [
            *("-m", "drivers.simulation.copter", "--name", self.name, "--system-id", str(self.system_id)),
            *("--link", f"udpout:127.0.0.1:{self.port}", f"--home={home}", "--seed", str(self.system_id)),
            *("--parent-pid", str(parent_pid), *time.arguments()),
            *(word for parameter in parameters for word in ("--param", parameter)),
        ]


@dataclass(frozen=True)
class _Command:
    """How a process is started."""

    arguments: Sequence[str]
    stdin: bytes
    folder: Path | None
    environment: Mapping[str, str]


@dataclass
class ProcessGroup:
    """The processes of one run by name; their output goes to one log file each."""

    log_dir: Path
    processes: dict[str, asyncio.subprocess.Process]
    _commands: dict[str, _Command] = field(default_factory=dict, init=False)

    async def start(
        self,
        name: str,
        arguments: Sequence[str],
        stdin: bytes = b"",
        folder: Path | None = None,
        environment: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Start a Python process of this installation, in its own folder and with more environment where given.

        SimulationError when it cannot be started.
        """
        self._commands[name] = _Command(tuple(arguments), stdin, folder, environment)
        await self._start(name, self._commands[name])

    async def restart(self, name: str) -> None:
        """Start a process of this group once more, as it was started; what still runs of it is killed.

        SimulationError when it cannot be started, or never was.
        """
        if name not in self.processes:
            raise SimulationError(f"there is no process of {name} to be started anew: it is not this run's own")
        process = self.processes[name]
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()
        await self._start(name, self._commands[name])

    async def _start(self, name: str, command: _Command) -> None:
        try:
            with (self.log_dir / f"{name}.log").open("ab") as log_file:
                process = await asyncio.create_subprocess_exec(
                    sys.executable,
                    *command.arguments,
                    stdin=asyncio.subprocess.PIPE,
                    stdout=log_file,
                    stderr=log_file,
                    cwd=command.folder,
                    env={**os.environ, **command.environment},
                    start_new_session=True,  # a Ctrl-C in the terminal is the service's to handle, not theirs
                )
        except OSError as error:
            raise SimulationError(f"the process of {name} cannot be started: {error}") from error
        self.processes[name] = process
        if process.stdin is not None:
            with contextlib.suppress(OSError):  # one that has already ended is noticed by its silence
                process.stdin.write(command.stdin)
                await process.stdin.drain()
                process.stdin.close()

    def require_running(self, name: str) -> None:
        """Return while a process runs; SimulationError with its last words when it has ended."""
        process = self.processes[name]
        if process.returncode is not None:
            words = last_words(self.log_dir / f"{name}.log")
            raise SimulationError(f"the process of {name} ended with status {process.returncode}: {words}")

    async def end(self) -> None:
        """End every process: politely, then for certain."""
        running = [process for process in self.processes.values() if process.returncode is None]
        for signal_number in (signal.SIGTERM, signal.SIGKILL):
            for process in running:
                with contextlib.suppress(ProcessLookupError):
                    process.send_signal(signal_number)
            waits = [asyncio.ensure_future(process.wait()) for process in running]
            if waits:
                await asyncio.wait(waits, timeout=_END_TIMEOUT_S)
            running = [process for process in running if process.returncode is None]


@contextlib.asynccontextmanager
async def process_group(log_dir: Path) -> AsyncIterator[ProcessGroup]:
    """Open a group of processes; they end with the block."""
    group = ProcessGroup(log_dir, {})
    try:
        yield group
    finally:
        await group.end()


def last_words(log: Path) -> str:
    """Return the last line of a process's log."""
    try:
        said = log.read_text(errors="replace").strip().splitlines()
    except OSError:
        said = []
    return said[-1] if said else "it said nothing"


def free_tcp_port() -> int:
    """Return a port on loopback that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def this_pid() -> int:
    """Return the process id the started processes are to watch."""
    return os.getpid()
