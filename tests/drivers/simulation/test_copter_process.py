"""The copter as a process: its links, its clock, its command line and its end."""

import os
import signal
import subprocess
import sys
import time

import pytest

from drivers.simulation.copter import main

pytestmark = pytest.mark.slow

GOOD = ["--name", "U1", "--system-id", "3", "--link", "udpout:127.0.0.1:9", "--home", "47.4,8.5,400,0"]


def test_it_speaks_first_on_udpout(start_copter, make_observer):
    observer = make_observer()
    start_copter([f"udpout:127.0.0.1:{observer.port}"])
    assert observer.wait(lambda o: o.latest["GLOBAL_POSITION_INT"].lat == -353632620)


def test_it_answers_the_latest_speaker_on_udpin(start_copter, make_observer, free_port):
    port = free_port()
    first, second, started = make_observer(), make_observer(), make_observer()
    start_copter([f"udpin:127.0.0.1:{port}", f"udpout:127.0.0.1:{started.port}"])
    assert started.wait(lambda _: True)
    first.announce_to(port)
    assert first.wait(lambda _: True)
    second.announce_to(port)
    assert second.wait(lambda _: True)


def test_simulated_time_runs_as_fast_as_asked_from_the_epoch(start_copter, make_observer):
    observer, epoch_ns = make_observer(), time.time_ns()
    start_copter([f"udpout:127.0.0.1:{observer.port}"], "--speedup", "20", "--epoch-ns", str(epoch_ns))
    assert observer.wait(lambda o: "SYSTEM_TIME" in o.latest and o.latest["SYSTEM_TIME"].time_boot_ms > 20_000)
    told_ns, now_ns = observer.latest["SYSTEM_TIME"].time_unix_usec * 1000, time.time_ns()
    assert epoch_ns + 20e9 < told_ns <= epoch_ns + (now_ns - epoch_ns) * 20


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_at_once_and_cleanly_on_a_signal(start_copter, make_observer, number):
    observer = make_observer()
    process = start_copter([f"udpout:127.0.0.1:{observer.port}"])
    assert observer.wait(lambda _: True)
    process.send_signal(number)
    assert process.wait(timeout=5) == 0
    assert process.stderr.read() == ""


def test_it_ends_when_its_parent_does(make_observer):
    observer = make_observer()
    link = f"udpout:127.0.0.1:{observer.port}"
    script = (
        "import os, subprocess, sys\n"
        "subprocess.Popen([sys.executable, '-m', 'drivers.simulation.copter', *sys.argv[1:],"
        " '--parent-pid', str(os.getpid())])\n"
        "sys.stdin.read()\n"
    )
    arguments = ["--name", "U1", "--system-id", "3", "--link", link, "--home", "0,0,0,0"]
    parent = subprocess.Popen([sys.executable, "-c", script, *arguments], stdin=subprocess.PIPE, env=os.environ)
    assert observer.wait(lambda _: True)
    parent.stdin.close()
    assert parent.wait(timeout=5) == 0
    deadline_s = time.monotonic() + 20.0
    while observer.wait(lambda _: True, timeout_s=1.5):
        assert time.monotonic() < deadline_s, "the copter outlived its parent"


def test_parameters_come_from_the_command_line(start_copter, make_observer):
    observer = make_observer()
    process = start_copter([f"udpout:127.0.0.1:{observer.port}"], "--param", "GUID_TIMEOUT=1", "--ready-after", "5")
    assert observer.wait(lambda o: "EKF_STATUS_REPORT" in o.latest)
    assert not observer.latest["EKF_STATUS_REPORT"].flags & 16
    assert process.poll() is None


@pytest.mark.parametrize(
    ("extra", "complaint"),
    [
        (["--home", "-35.1,149.2"], "is not a home"),
        (["--home", "95,149.2,0,0"], "is not a home"),
        (["--link", "tcp:127.0.0.1:5760"], "is not a link"),
        (["--link", "udpin:127.0.0.1:99999"], "is not a link"),
        (["--system-id", "0"], "is not a system id"),
        (["--speedup", "0"], "is not a speedup"),
        (["--param", "NO_SUCH=1"], "is not NAME=VALUE"),
        (["--param", "GUID_TIMEOUT=nan"], "is not NAME=VALUE"),
        (["--frobnicate"], "unrecognized arguments"),
    ],
)
def test_a_wrong_argument_is_one_clear_line(capsys, extra, complaint):
    with pytest.raises(SystemExit) as caught:
        main([*GOOD, *extra])
    assert caught.value.code == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count("\n") == 1


def test_a_port_in_use_is_one_clear_line(capsys, make_observer):
    taken = make_observer()
    assert main([*GOOD, "--link", f"udpin:127.0.0.1:{taken.port}"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("U1: cannot open a link: ")
    assert said.count("\n") == 1
