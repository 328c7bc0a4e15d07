"""The autopilots' own simulators (SITL): how a program the user has is found, and its command line for one vehicle."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Final

from drivers.errors import SimulationError
from drivers.simulation.launcher import ProcessGroup
from drivers.simulation.weather import CALM, SimulatedWeather, arducopter_parameters, px4_parameters
from planner.frames import GeodeticPosition

PX4_OFFBOARD_PORT: Final = 14540
PX4_INSTANCES: Final = 10
"""PX4 gives all further ones the same port."""


@dataclass(frozen=True)
class SitlVehicle:
    """One vehicle to be simulated: who it is, where it starts, and the UDP port of the link it speaks to."""

    name: str
    system_id: int
    port: int
    home: GeodeticPosition
    weather: SimulatedWeather = CALM
    station_id: int = 255
    """The system id of the station whose heartbeats its failsafe counts."""
    speedup: float = 1.0
    """How fast it starts; whoever starts it faster than real time waits with `sitl_readiness.until_ready`."""


@dataclass(frozen=True)
class SitlCommand:
    """What starts the simulator of one vehicle, in a folder of its own with these files."""

    arguments: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Sitl:
    """One autopilot's simulator, started from a program that the user has."""

    program_name: str
    variable: str
    """The environment variable that names the program."""
    documentation: str
    """How its makers install it."""
    command: Callable[[Path, SitlVehicle, Path], SitlCommand]
    """Returns what starts a program for a vehicle in a folder."""
    port: Callable[[int], int]
    """The port it speaks to for a system id; 0: any it is told."""
    start_speedup: float = 1.0
    """How much faster than real time it may be until its estimator is ready."""

    def find(self) -> Path:
        """Return the program. SimulationError when there is none, with how to get it."""
        named = os.environ.get(self.variable)
        found = shutil.which(named or self.program_name)
        if found is not None:
            return Path(found).resolve()
        missing = f"{self.variable}={named} is no program" if named else f"no {self.program_name} was found"
        raise SimulationError(
            f"{missing}: set {self.variable} to the {self.program_name} program, or put it on PATH. To get it: "
            f"{self.documentation}. Without --sitl the playbook flies on embedded copters, which need nothing"
        )

    async def start(self, vehicle: SitlVehicle, group: ProcessGroup) -> None:
        """Start one vehicle's simulator, which ends with the group or this process. SimulationError when it cannot.

        Its working directory is its own, beside its log: what an autopilot writes there would be read by the next one.
        """
        folder = (group.log_dir / vehicle.name).absolute()
        command = self.command(self.find(), vehicle, folder)
        _make(folder, command.files)
        tether = ["-m", "drivers.simulation.tethered", str(os.getpid())]
        paths = os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = {"PYTHONPATH": paths, **command.environment}
        await group.start(vehicle.name, [*tether, *command.arguments], folder=folder, environment=environment)


def _make(folder: Path, files: Mapping[str, str]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name).write_text(text)
    except OSError as error:
        raise SimulationError(f"the folder {folder} cannot be made: {error}") from error


def parameters(text: str) -> dict[str, str]:
    """Return the parameters of a file with lines `NAME VALUE # reason`."""
    lines = (line.partition("#")[0].split() for line in text.splitlines())
    return {line[0]: line[1] for line in lines if line}


def _arducopter(program: Path, vehicle: SitlVehicle, folder: Path) -> SitlCommand:
    at = vehicle.home
    own = {
        "SYSID_MYGCS": vehicle.station_id,
        "MAV_GCS_SYSID": vehicle.station_id,  # its name from 4.7 on; an unknown name is skipped
        **arducopter_parameters(vehicle.weather),
    }
    files = {"own.parm": "".join(f"{name} {value:g}\n" for name, value in own.items())}
    defaults = f"{_parameter_file('arducopter_swarm.parm')},{folder.absolute() / 'own.parm'}"
    return SitlCommand(
        (
            *(str(program), "--model", "+", "--speedup", f"{vehicle.speedup:g}", "--rate", "400", "--wipe"),
            *("-I", str(vehicle.system_id - 1), "--sysid", str(vehicle.system_id)),
            *("--home", f"{at.latitude_deg:.9f},{at.longitude_deg:.9f},{at.altitude_m:.3f},0"),
            *("--defaults", defaults),
            *("--serial0", f"udpclient:127.0.0.1:{vehicle.port}", "--serial1", "none", "--serial2", "none"),
        ),
        files=files,
    )


def _px4(program: Path, vehicle: SitlVehicle, _folder: Path) -> SitlCommand:
    if vehicle.system_id > PX4_INSTANCES:
        raise SimulationError(f"PX4's simulator flies {PX4_INSTANCES} vehicles at most: {vehicle.name} is one more")
    etc = program.parent.parent / "etc"
    if not etc.is_dir():
        raise SimulationError(f"PX4's start-up files are not beside {program}: {etc} is no folder")
    at = vehicle.home
    weather = {name: f"{value:g}" for name, value in px4_parameters(vehicle.weather, program).items()}
    set_at_start = parameters(_parameter_file("px4_swarm.params").read_text()) | weather
    return SitlCommand(
        (str(program), "-i", str(vehicle.system_id - 1), "-d", str(etc)),
        {
            "PX4_SIM_MODEL": "sihsim_quadx",
            "PX4_HOME_LAT": f"{at.latitude_deg:.9f}",
            "PX4_HOME_LON": f"{at.longitude_deg:.9f}",
            "PX4_HOME_ALT": f"{at.altitude_m:.3f}",
            **{f"PX4_PARAM_{name}": value for name, value in set_at_start.items()},
        },
    )


def _parameter_file(name: str) -> Path:
    return Path(str(files("sitl_configs") / name))


SITLS: Final[dict[str, Sitl]] = {
    "ardupilot": Sitl(
        program_name="arducopter",
        variable="ARDUCOPTER",
        documentation="https://ardupilot.org/dev/docs/building-the-code.html (./waf configure --board sitl copter)",
        command=_arducopter,
        port=lambda _system_id: 0,
        start_speedup=10.0,  # its estimator takes 42 s
    ),
    "px4": Sitl(
        program_name="px4",
        variable="PX4",
        documentation="https://docs.px4.io/main/en/dev_setup/building_px4 (make px4_sitl_default)",
        command=_px4,
        port=lambda system_id: PX4_OFFBOARD_PORT + system_id - 1,
    ),
}
