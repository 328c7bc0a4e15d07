"""Processes that outlive the one that started them are found again, and only they are ended."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drivers.errors import SimulationError
from drivers.simulation.detached import DetachedProcess, end, start_detached

FOREVER = "import signal; print('here', flush=True); signal.pause()"
STUBBORN = f"import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); {FOREVER}"
pytestmark = pytest.mark.slow


@pytest.fixture
def started(tmp_path):
    """Start Python code detached; what still runs at the end is ended."""
    running = []

    def start(code, stdin=b""):
        log = tmp_path / f"{len(running)}.log"
        running.append(start_detached(["-c", code], log, stdin))
        return running[-1], log

    yield start
    end(running)


def until(condition):
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def test_it_gets_its_input_and_its_output_goes_to_its_log(started):
    process, log = started("import sys; print(sys.stdin.read()[::-1], flush=True)", b"relay")
    until(lambda: not process.runs)
    assert log.read_text() == "yaler\n"


def test_it_outlives_the_process_that_started_it(tmp_path):
    script = (
        "import sys; from pathlib import Path; from drivers.simulation.detached import start_detached; import msgspec\n"
        "print(msgspec.json.encode(start_detached(['-c', sys.argv[1]], Path(sys.argv[2]), b'')).decode())"
    )
    log = tmp_path / "log"
    said = subprocess.run([sys.executable, "-c", script, FOREVER, log], capture_output=True, check=True).stdout
    process = DetachedProcess(**json.loads(said))
    until(lambda: log.read_text() == "here\n")
    assert process.runs
    assert os.getsid(process.pid) == process.pid != os.getsid(0)
    assert end([process]) == []
    assert not process.runs


def test_a_process_id_given_to_another_is_left_alone(started):
    bystander, log = started(FOREVER)
    until(lambda: log.read_text() == "here\n")
    earlier = DetachedProcess(bystander.pid, bystander.started_ticks - 1)
    assert not earlier.runs
    assert end([earlier]) == []
    assert bystander.runs


def test_what_has_ended_already_needs_no_ending(started):
    process, _ = started("pass")
    until(lambda: not process.runs)
    assert end([process, process]) == []


def test_one_that_will_not_end_is_ended_for_certain(started):
    polite, first = started(FOREVER)
    stubborn, second = started(STUBBORN)
    until(lambda: first.read_text() == second.read_text() == "here\n")
    assert end([polite, stubborn], patience_s=0.5) == []
    assert not polite.runs
    assert not stubborn.runs


def test_a_process_that_cannot_be_started_is_an_error(tmp_path):
    with pytest.raises(SimulationError, match="no such folder"):
        start_detached(["-c", ""], tmp_path / "no such folder" / "log", b"")


def test_the_process_of_an_id_is_known_by_its_start():
    process = DetachedProcess.of(os.getpid())
    assert process.runs
    assert process.started_ticks == int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
    assert not DetachedProcess.of(2**22 + 1).runs  # beyond the largest id there can be
