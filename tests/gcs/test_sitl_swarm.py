"""`sitl up`, `status` and `down`, with a stand-in for ArduCopter's simulator: what it starts, leaves, and ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.simulation.detached import DetachedProcess, end
from gcs.playbook.loader import load_playbook

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
STAND_IN = ROOT / "tests" / "drivers" / "simulation" / "fake_arducopter.py"
UAVS = ("L0", "L1", "U1")
PLAYBOOK = """\
playbook: 1
name: three # kept as it is
formation: {kind: custom, slots: {O1: [70, 60]}}
transmitters:
  L0: {at: [0, 0]}
  L1: {at: [100, 0]}
receivers:
  U1: {start: [20, 30]}
simulation: {wind_mps: 4}
"""


class Swarm:
    """The command, and the folder it works on."""

    def __init__(self, program: Path, tmp_path: Path) -> None:
        self.folder = tmp_path / "swarm"
        self.path = tmp_path / "three.yaml"
        self.path.write_text(PLAYBOOK)
        self.environment = {**os.environ, "ARDUCOPTER": str(program)}

    def begin(self, fault: str = "", autopilot: str = "ardupilot") -> subprocess.Popen[str]:
        command = ["up", str(self.path), "--autopilot", autopilot, "--folder", str(self.folder)]
        return subprocess.Popen(
            [sys.executable, "-m", "gcs.cli", "sitl", *command],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
            env={**self.environment, "FAKE": fault},
        )  # fmt: skip

    def up(self, fault: str = "", autopilot: str = "ardupilot") -> tuple[int, str]:
        return finished(self.begin(fault, autopilot))

    def say(self, command: str) -> tuple[int, str]:
        words = [sys.executable, "-m", "gcs.cli", "sitl", command, "--folder", str(self.folder)]
        return finished(subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT))

    def processes(self) -> dict[str, DetachedProcess]:
        try:
            state = json.loads((self.folder / "sitl.json").read_text())
        except FileNotFoundError:
            return {}
        kept = {name: vehicle["process"] for name, vehicle in state["vehicles"].items()}
        return {name: DetachedProcess(**process) for name, process in {"keeper": state["keeper"], **kept}.items()}


@pytest.fixture
def swarm(tmp_path: Path) -> Iterator[Swarm]:
    program = tmp_path / "arducopter"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} {STAND_IN} "$@"\n')
    program.chmod(0o755)
    made = Swarm(program, tmp_path)
    yield made
    end(made.processes().values())


def finished(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Return the exit status of a command and all it said, its lines joined."""
    said, complained = process.communicate(timeout=60)
    assert "Traceback" not in complained
    return process.returncode, " ".join((said + complained).split())


def until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def test_a_swarm_outlives_the_command_is_flown_by_its_playbook_and_ended_by_another_command(swarm: Swarm) -> None:
    status, said = swarm.up()
    assert status == 0, said
    assert "3 vehicles ready after" in said
    assert f"bearing-relay fly {swarm.folder / 'playbook.yaml'}" in said
    processes = swarm.processes()
    assert set(processes) == {"keeper", "L0", "L1", "U1"}
    time.sleep(0.5)  # long enough for a simulator that ends with the process that started it
    assert all(process.runs for process in processes.values())
    assert swarm.say("status")[0] == 0

    text, playbook = (swarm.folder / "playbook.yaml").read_text(), load_playbook(swarm.folder / "playbook.yaml")
    assert "name: three # kept as it is" in text
    assert playbook.vehicles is not None
    assert [at.system_id for at in playbook.vehicles.values()] == [1, 2, 3]
    assert len({at.link for at in playbook.vehicles.values()}) == 3
    assert playbook.sensor.simulated is True
    assert "SIM_WIND_SPD 4" in (swarm.folder / "vehicles" / "U1" / "own.parm").read_text()

    assert swarm.say("down") == (0, "ended L0, L1, U1")
    assert not any(process.runs for process in processes.values())
    assert swarm.say("down") == (0, f"no simulator is up in {swarm.folder}")
    assert swarm.say("status")[0] == 1
    assert swarm.up()[0] == 0, "the folder can be used again"


def test_a_swarm_that_is_up_is_not_started_twice(swarm: Swarm) -> None:
    assert swarm.up()[0] == 0
    before = swarm.processes()
    status, said = swarm.up()
    assert status == 2
    assert f"3 simulators are up in {swarm.folder} already: bearing-relay sitl down --folder {swarm.folder}" in said
    assert swarm.processes() == before


def test_one_that_has_ended_is_told_by_status_and_the_others_are_ended(swarm: Swarm) -> None:
    swarm.up()
    processes = swarm.processes()
    os.kill(processes["L1"].pid, signal.SIGKILL)
    until(lambda: not processes["L1"].runs)
    status, said = swarm.say("status")
    assert status == 1
    assert said.count("runs") == 2
    assert "has ended" in said
    assert swarm.say("down") == (0, "ended L0, U1")


def test_with_the_keeper_killed_no_simulator_is_left(swarm: Swarm) -> None:
    swarm.up()
    processes = swarm.processes()
    os.kill(processes["keeper"].pid, signal.SIGKILL)
    until(lambda: not any(process.runs for process in processes.values()))
    assert swarm.say("down") == (0, f"no simulator is up in {swarm.folder}")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_interrupted_while_it_waits_it_leaves_nothing(swarm: Swarm, number: signal.Signals) -> None:
    process = swarm.begin("3=lost")
    until(lambda: len(swarm.processes()) == 4)
    started = swarm.processes()
    process.send_signal(number)
    status, said = finished(process)
    assert status == 130
    assert "every simulator that was started has been ended" in said
    assert not any(one.runs for one in started.values())
    assert not (swarm.folder / "playbook.yaml").exists()


def test_a_simulator_that_ends_at_once_ends_the_others_and_says_why(swarm: Swarm) -> None:
    status, said = swarm.up("2=dead")
    assert status == 2
    assert "the process of L1 has ended: PANIC: no airframe" in said
    assert "vehicles/L1.log" in said
    assert swarm.processes() == {}


def test_killed_while_it_waits_its_simulators_are_still_found(swarm: Swarm) -> None:
    process = swarm.begin("3=silent")
    until(lambda: len(swarm.processes()) == 4)
    started = swarm.processes()
    process.kill()
    process.communicate()
    assert all(one.runs for one in started.values())
    assert swarm.say("down") == (0, "ended L0, L1, U1")
    assert not any(one.runs for one in started.values())


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ("vehicles: {L0: {link: 'udpin:127.0.0.1:1', system_id: 1}}\n", "have no link"),
        ("mavlink: {system_id: 2}\n", "which is this service's own"),
        ("mavlink: {signing: {key_variable: KEY}}\n", "leave out mavlink.signing"),
        ("receivers: {}\n", "three.yaml:10:1"),
    ],
)
def test_a_playbook_that_could_not_be_flown_starts_nothing(swarm: Swarm, change: str, complaint: str) -> None:
    swarm.path.write_text(PLAYBOOK + change)
    status, said = swarm.up()
    assert status == 2
    assert complaint in said
    assert swarm.processes() == {}


def test_a_playbook_that_names_its_vehicles_is_not_simulated(swarm: Swarm) -> None:
    links = [f"{name}: {{link: 'udpin:127.0.0.1:1{n}', system_id: {n}}}" for n, name in enumerate(UAVS, 1)]
    swarm.path.write_text(f"{PLAYBOOK}vehicles: {{{', '.join(links)}}}\n")
    status, said = swarm.up()
    assert status == 2
    assert "names its vehicles already: sitl up starts them itself, leave out 'vehicles'" in said


def test_more_vehicles_than_the_simulator_has_ports_for_are_refused_before_any_is_started(swarm: Swarm) -> None:
    receivers = "".join(f"  U{n}: {{start: [{20 * n}, 30]}}\n" for n in range(1, 10))
    slots = ", ".join(f"O{n}: [{20 * n}, 60]" for n in range(1, 10))
    swarm.path.write_text(
        f"playbook: 1\nname: eleven\nformation: {{kind: custom, slots: {{{slots}}}}}\n"
        f"transmitters:\n  L0: {{at: [0, 0]}}\n  L1: {{at: [200, 0]}}\nreceivers:\n{receivers}"
    )
    (swarm.path.parent / "etc").mkdir()
    program = swarm.path.parent / "bin" / "px4"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\ntouch started\n")
    program.chmod(0o755)
    swarm.environment["PX4"] = str(program)
    status, said = swarm.up(autopilot="px4")
    assert status == 2
    assert "PX4's simulator flies 10 vehicles at most: U9 is one more" in said
    assert swarm.processes() == {}
    assert not list(swarm.folder.glob("**/started"))


def test_a_folder_with_other_things_in_it_is_left_alone(swarm: Swarm) -> None:
    swarm.folder.mkdir()
    (swarm.folder / "thesis.txt").write_text("dear")
    status, said = swarm.up()
    assert status == 2
    assert f"{swarm.folder} holds other things: choose another --folder" in said
    assert [entry.name for entry in swarm.folder.iterdir()] == ["thesis.txt"]


def test_without_the_program_the_way_to_get_it_is_named(swarm: Swarm) -> None:
    swarm.environment["ARDUCOPTER"] = "/nowhere/arducopter"
    status, said = swarm.up()
    assert status == 2
    assert "ARDUCOPTER=/nowhere/arducopter is no program" in said
    assert not swarm.folder.exists()
