"""The launcher starts the processes of a run and ends exactly those."""

import asyncio
import itertools
import os
import signal
import socket
import sys
import time
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.errors import SimulationError
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import open_link
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import CopterSpec, SimulatedTime, free_tcp_port, process_group, this_pid
from drivers.simulation.weather import SimulatedWeather
from planner.frames import GeodeticPosition

PATIENCE_S = 10.0
FOREVER = "import signal; print('here', flush=True); signal.pause()"
STUBBORN = f"import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); {FOREVER}"
HOME = GeodeticPosition(-35.363262, 149.165237, 584.0)


class StopError(Exception):
    pass


@pytest.fixture
async def group(tmp_path):
    async with process_group(tmp_path) as group:
        yield group


async def said(group, name, words):
    """Wait until a process has written something to its log."""
    async with asyncio.timeout(PATIENCE_S):
        while words not in (group.log_dir / f"{name}.log").read_text():  # noqa: ASYNC110 - a file tells nobody
            await asyncio.sleep(0.01)


async def freeze(process):
    """Stop a process and wait until it has stopped."""
    process.send_signal(signal.SIGSTOP)
    async with asyncio.timeout(PATIENCE_S):
        while not stopped(process.pid):  # noqa: ASYNC110 - nor does a stopped process
            await asyncio.sleep(0.01)


def stopped(pid):
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "T"


def runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_copters_command_line_carries_all_it_is_told():
    spec = CopterSpec("U3", 3, 14553, HOME, heading_deg=90.0)
    words = spec.arguments(SimulatedTime(10.0, 123), parent_pid=77)
    assert words[:2] == ["-m", "drivers.simulation.copter"]
    line = " ".join(words)
    assert "--name U3 --system-id 3 --link udpout:127.0.0.1:14553" in line
    assert "--home=-35.363262000,149.165237000,584.000,90" in line
    assert "--parent-pid 77 --speedup 10 --epoch-ns 123" in line


def test_a_copter_is_told_of_the_air_and_of_the_station_whose_heartbeats_count():
    spec = CopterSpec("U3", 3, 14553, HOME, weather=SimulatedWeather(wind_mps=4.0), station_id=200)
    words = spec.arguments(SimulatedTime(1.0, 0), parent_pid=77)
    told = [word for option, word in itertools.pairwise(words) if option == "--param"]
    assert {"SIM_WIND_SPD=4", "SYSID_MYGCS=200"} <= set(told)


def test_a_free_port_can_be_listened_on():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", free_tcp_port()))
    assert this_pid() == os.getpid()


@pytest.mark.slow
async def test_a_process_gets_its_input_and_its_output_goes_to_its_log(group):
    script = "import sys; print(sys.stdin.read()[::-1]); sys.stderr.write('and an error'); sys.exit(3)"
    await group.start("mirror", ["-c", script], stdin=b"relay")
    assert await asyncio.wait_for(group.processes["mirror"].wait(), PATIENCE_S) == 3
    assert (group.log_dir / "mirror.log").read_text() in ("yaler\nand an error", "and an erroryaler\n")


@pytest.mark.slow
async def test_while_a_process_runs_it_may_be_required_to(group):
    await group.start("here", ["-c", FOREVER])
    await said(group, "here", "here")
    group.require_running("here")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "last_words"),
    [
        ("import sys; sys.stderr.write('first\\nthe port is taken\\n\\n'); sys.exit(5)", "status 5: the port is taken"),
        ("import os; os._exit(6)", "status 6: it said nothing"),
        ("import os; os.write(1, bytes([255, 254, 10])); os._exit(1)", "status 1: "),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", f"status -{int(signal.SIGKILL)}: it said nothing"),
    ],
)
async def test_a_process_that_has_ended_is_an_error_with_its_last_words(group, script, last_words):
    await group.start("gone", ["-c", script])
    await asyncio.wait_for(group.processes["gone"].wait(), PATIENCE_S)
    with pytest.raises(SimulationError, match=f"the process of gone ended with {last_words}"):
        group.require_running("gone")


@pytest.mark.slow
async def test_a_process_that_ends_before_it_reads_its_input_does_not_fail_the_start(group):
    await group.start("deaf", ["-c", "import os; os._exit(0)"], stdin=bytes(1_000_000))
    assert await asyncio.wait_for(group.processes["deaf"].wait(), PATIENCE_S) == 0


@pytest.mark.slow
async def test_a_process_is_started_anew_as_it_was_and_its_log_goes_on(group):
    script = f"import sys; print(sys.stdin.read(), flush=True); {FOREVER}"
    await group.start("again", ["-c", script], stdin=b"told")
    await said(group, "again", "here")
    first = group.processes["again"]
    await group.restart("again")
    assert first.returncode == -signal.SIGKILL
    await said(group, "again", "told\nhere\ntold\nhere\n")
    group.require_running("again")


async def test_what_was_never_started_is_not_started_anew(group):
    with pytest.raises(SimulationError, match="no process of U1 to be started anew"):
        await group.restart("U1")


async def test_a_process_that_cannot_be_started_is_an_error_that_names_it(tmp_path):
    async with process_group(tmp_path / "no such folder") as group:
        with pytest.raises(SimulationError, match=r"the process of U1 cannot be started: .*no such folder"):
            await group.start("U1", ["-c", ""])
        assert group.processes == {}


@pytest.mark.slow
async def test_the_block_ends_its_own_processes_however_it_ends_and_no_others(tmp_path):
    async def body():
        async with process_group(tmp_path) as group:
            await group.start("one", ["-c", FOREVER])
            await group.start("two", ["-c", FOREVER])
            await group.start("done", ["-c", ""])
            started.update(group.processes)
            await started["done"].wait()
            await said(group, "two", "here")
            await said(group, "one", "here")
            raise StopError

    started = {}
    bystander = await asyncio.create_subprocess_exec(sys.executable, "-c", FOREVER, stdout=asyncio.subprocess.DEVNULL)
    try:
        with pytest.raises(StopError):
            await body()
        assert not any(runs(process.pid) for process in started.values())
        assert {started[name].returncode for name in ("one", "two")} == {-signal.SIGTERM}
        assert bystander.returncode is None
        assert runs(bystander.pid)
    finally:
        bystander.kill()
        await bystander.wait()


@pytest.mark.slow
async def test_a_process_that_will_not_end_is_ended_for_certain(tmp_path):
    async with process_group(tmp_path) as group:
        await group.start("stubborn", ["-c", STUBBORN])
        await group.start("frozen", ["-c", FOREVER])
        await said(group, "stubborn", "here")
        await said(group, "frozen", "here")
        await freeze(group.processes["frozen"])
        started_s = time.monotonic()
    assert time.monotonic() - started_s < 4.0
    assert {process.returncode for process in group.processes.values()} == {-signal.SIGKILL}


@pytest.mark.slow
async def test_a_ctrl_c_in_the_terminal_is_not_theirs(group):
    await group.start("here", ["-c", FOREVER])
    pid = group.processes["here"].pid
    assert os.getsid(pid) == pid != os.getsid(0)


@pytest.mark.slow
async def test_a_copter_started_by_its_spec_is_heard_on_its_link_and_tells_no_more_than_it_is_asked(group):
    clock = SystemClock(speedup=10.0, epoch_ns=time.time_ns())
    async with open_link(LinkAddress("udpin", "127.0.0.1", 0), Codec(), clock) as link:
        vehicle = Vehicle("U3", 3, link, clock)
        spec = CopterSpec("U3", 3, link.address.port, HOME)
        await group.start("U3", spec.arguments(SimulatedTime(clock.speedup, clock.epoch_ns), this_pid()))
        heartbeats = []
        vehicle.on_heartbeat.append(heartbeats.append)
        await vehicle.wait_until(
            lambda: len(heartbeats) > 3, PATIENCE_S * clock.speedup, "heartbeat", "See the copter's log."
        )
        group.require_running("U3")
        assert not vehicle.armed
        assert vehicle.telemetry.kinematics is None
