"""The autopilots' own simulators: how the user's program is found, and the command line for one vehicle."""

import asyncio
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drivers.errors import SimulationError
from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.autopilots.px4 import Px4Copter
from drivers.simulation.launcher import process_group
from drivers.simulation.sitl import SITLS, SitlVehicle, parameters
from drivers.simulation.weather import SimulatedWeather
from planner.frames import GeodeticPosition

FOLDER = Path("/runs/logs/U3")
HOME = GeodeticPosition(-35.363262, 149.165237, 584.0)
CONFIGS = Path("sitl_configs")
PROGRAM = '#!/bin/sh\necho "in $(basename $PWD) with $*"; env | grep ^PX4_ | sort; exec sleep 30\n'


@pytest.fixture
def program(tmp_path):
    """A program laid out as the autopilots' builds are: bin/NAME beside etc/."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "etc").mkdir()
    path = tmp_path / "bin" / "autopilot"
    path.write_text(PROGRAM)
    path.chmod(0o755)
    return path


@pytest.mark.parametrize("name", SITLS)
def test_the_program_named_by_the_environment_is_taken(monkeypatch, program, name):
    monkeypatch.setenv(SITLS[name].variable, str(program))
    assert SITLS[name].find() == program


@pytest.mark.parametrize("name", SITLS)
def test_a_program_on_the_path_is_found_by_its_own_name(monkeypatch, program, name):
    monkeypatch.delenv(SITLS[name].variable, raising=False)
    monkeypatch.setenv("PATH", str(program.parent))
    (program.parent / SITLS[name].program_name).symlink_to(program)
    assert SITLS[name].find() == program


@pytest.mark.parametrize("named", [None, "/nowhere/autopilot"])
@pytest.mark.parametrize(("name", "site"), [("ardupilot", "ardupilot.org"), ("px4", "docs.px4.io")])
def test_without_a_program_the_error_says_how_to_get_one_and_what_flies_without(
    monkeypatch, tmp_path, named, name, site
):
    variable = SITLS[name].variable
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(variable, raising=False)
    if named is not None:
        monkeypatch.setenv(variable, named)
    with pytest.raises(SimulationError, match=rf"set {variable} to the .*{site}.*embedded copters") as caught:
        SITLS[name].find()
    assert named is None or f"{variable}={named}" in str(caught.value)


def test_arducopter_s_command_line_carries_all_it_is_told():
    command = SITLS["ardupilot"].command(Path("/opt/arducopter"), SitlVehicle("U3", 3, 14553, HOME), FOLDER)
    line = " ".join(command.arguments)
    assert line.startswith("/opt/arducopter --model + --speedup 1 ")
    assert "-I 2 --sysid 3" in line
    assert "--home -35.363262000,149.165237000,584.000,0" in line
    assert "--serial0 udpclient:127.0.0.1:14553" in line
    swarm, own = command.arguments[command.arguments.index("--defaults") + 1].split(",")
    assert Path(swarm).is_file()
    assert own == "/runs/logs/U3/own.parm"
    assert command.environment == {}


def test_arducopter_s_failsafe_counts_this_station_s_heartbeats_in_every_version_and_the_air_is_as_asked_for():
    weather = SimulatedWeather(wind_mps=5.0)
    vehicle = SitlVehicle("U3", 3, 14553, HOME, weather, station_id=200, speedup=10.0)
    command = SITLS["ardupilot"].command(Path("/opt/arducopter"), vehicle, FOLDER)
    own = parameters(command.files["own.parm"])
    assert own["SYSID_MYGCS"] == own["MAV_GCS_SYSID"] == "200"
    assert own["SIM_WIND_SPD"] == "5"
    assert "--speedup 10 " in " ".join(command.arguments)


def test_px4_gets_its_instance_its_place_and_its_parameters(program):
    command = SITLS["px4"].command(program, SitlVehicle("U3", 3, 14542, HOME), FOLDER)
    assert command.arguments == (str(program), "-i", "2", "-d", str(program.parent.parent / "etc"))
    assert command.environment["PX4_SIM_MODEL"] == "sihsim_quadx"
    assert command.environment["PX4_HOME_LAT"] == "-35.363262000"
    assert command.environment["PX4_PARAM_COM_OBL_RC_ACT"] == "5"


def test_a_px4_that_simulates_wind_is_told_of_it(program):
    program.write_text(f"{PROGRAM}# SIH_WIND_N")
    vehicle = SitlVehicle("U3", 3, 14542, HOME, SimulatedWeather(wind_mps=5.0))
    assert SITLS["px4"].command(program, vehicle, FOLDER).environment["PX4_PARAM_SIH_WIND_N"] == "5"


def test_px4_speaks_to_a_port_of_its_own_choice_and_arducopter_to_any():
    assert [SITLS["px4"].port(system_id) for system_id in (1, 2, 10)] == [14540, 14541, 14549]
    assert SITLS["ardupilot"].port(5) == 0


def test_more_vehicles_than_px4_has_ports_for_are_refused(program):
    with pytest.raises(SimulationError, match="10 vehicles at most: U11 is one more"):
        SITLS["px4"].command(program, SitlVehicle("U11", 11, 14549, HOME), FOLDER)


def test_a_px4_without_its_start_up_files_says_where_they_should_be(program):
    (program.parent.parent / "etc").rmdir()
    with pytest.raises(SimulationError, match=r"start-up files are not beside .*/etc is no folder"):
        SITLS["px4"].command(program, SitlVehicle("U1", 1, 14540, HOME), FOLDER)


@pytest.mark.parametrize("path", [*CONFIGS.glob("*.parm"), *CONFIGS.glob("*.params")], ids=lambda path: path.name)
def test_every_parameter_is_a_name_and_a_value_with_its_reason(path):
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    assert lines
    for line in lines:
        assert re.fullmatch(r"[A-Z][A-Z0-9_]{1,15} +-?[\d.]+ +# \S.*", line), line
    assert len(parameters(path.read_text())) == len(lines), "a parameter is set twice"


@pytest.mark.parametrize(
    ("name", "autopilot"), [("arducopter_swarm.parm", ArduCopter()), ("px4_swarm.params", Px4Copter())]
)
def test_an_aircraft_is_told_to_set_what_is_checked_before_a_flight_and_nothing_of_the_simulator(name, autopilot):
    aircraft, simulator = (CONFIGS / name).read_text().split("# Of the simulator alone")
    set_on_both, set_in_the_simulator = set(parameters(aircraft)), set(parameters(simulator))
    assert len(set_on_both & set(autopilot.parameters.reads)) >= 4
    assert not set_in_the_simulator & set(autopilot.parameters.reads)
    assert not [name for name in set_on_both if name.startswith(("SIH_", "SIM_", "INS_", "EKF2_", "BATT_"))]


def test_both_autopilots_stop_by_themselves_a_second_after_the_last_setpoint():
    copter = parameters((CONFIGS / "arducopter_swarm.parm").read_text())
    px4 = parameters((CONFIGS / "px4_swarm.params").read_text())
    assert float(copter["GUID_TIMEOUT"]) == float(px4["COM_OF_LOSS_T"]) == 1.0
    assert px4["COM_OBL_RC_ACT"] == "5"
    assert copter["SYSID_MYGCS"] == "255"


@pytest.mark.slow
async def test_a_vehicle_finds_its_own_parameters_in_its_folder(monkeypatch, program, tmp_path):
    monkeypatch.setenv("ARDUCOPTER", str(program))
    async with process_group(tmp_path) as group:
        await SITLS["ardupilot"].start(SitlVehicle("U1", 1, 14601, HOME), group)
        assert "SYSID_MYGCS 255\n" in (tmp_path / "U1" / "own.parm").read_text()


@pytest.mark.slow
async def test_a_vehicle_runs_in_a_folder_of_its_own_with_its_environment_and_ends_with_the_group(
    monkeypatch, program, tmp_path
):
    monkeypatch.setenv("PX4", str(program))
    logs = tmp_path / "logs"
    logs.mkdir()
    async with process_group(logs) as group:
        await SITLS["px4"].start(SitlVehicle("U1", 1, 14540, HOME), group)
        async with asyncio.timeout(10.0):
            while "PX4_SIM_MODEL" not in (said := (logs / "U1.log").read_text()):  # noqa: ASYNC110 - a file tells nobody
                await asyncio.sleep(0.01)
        assert "in U1 with -i 0 -d " in said
        assert "PX4_PARAM_COM_OF_LOSS_T=1" in said
        process = group.processes["U1"]
    assert process.returncode == -signal.SIGTERM


@pytest.mark.slow
def test_a_vehicle_does_not_outlive_a_service_that_was_killed(program):
    script = (
        "import os, subprocess, sys, time\n"
        "arguments = [sys.executable, '-m', 'drivers.simulation.tethered', str(os.getpid()), sys.argv[1]]\n"
        "print(subprocess.Popen(arguments, stdout=subprocess.DEVNULL).pid, flush=True)\n"
        "time.sleep(30)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script, str(program)], stdout=subprocess.PIPE, text=True) as service:
        try:
            pid = int(service.stdout.readline())
            _until(lambda: b"sleep" in _command_line(pid), "the program runs in its place")
        finally:
            service.kill()
    _until(lambda: not _command_line(pid), "it has ended")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parent_pid", "named", "complaint"),
    [(os.getpid, "/nowhere/px4", "cannot be run"), (lambda: 1, "/bin/true", "parent has already ended")],
)
def test_what_cannot_be_run_says_so_in_one_line(parent_pid, named, complaint):
    ran = subprocess.run(
        [sys.executable, "-m", "drivers.simulation.tethered", str(parent_pid()), named],
        capture_output=True, text=True, check=False, timeout=10,
    )  # fmt: skip
    assert ran.returncode == 1
    assert complaint in ran.stderr
    assert ran.stderr.count("\n") == 1


def _until(condition, awaited):
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s, f"not in time: {awaited}"
        time.sleep(0.01)


def _command_line(pid):
    """Return the command line of a process; empty when it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except FileNotFoundError:
        return b""
