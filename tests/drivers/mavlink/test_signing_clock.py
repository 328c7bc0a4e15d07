"""Signing timestamps only ever grow: over crashes, clocks set back, and disks that fail."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import pytest

from drivers.mavlink.signing_clock import UNITS_PER_S, SigningClock, default_state_file, open_signing_clock
from tests.fakes import FAKE_UNIX_NS, ManualClock, settle

NOW = (FAKE_UNIX_NS - 1_420_070_400 * 10**9) // 10_000
LATEST = 2**48 - 2**40
PATIENCE_S = 10.0


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "state" / "timestamp"


def stored(path):
    return int(path.read_text())


async def until(condition):
    """Wait for the thread that writes."""
    for _ in range(10_000):
        if condition():
            return
        await asyncio.sleep(0.001)
    pytest.fail("nothing was written")


async def test_timestamps_count_10_us_since_2015(clock, path):
    async with open_signing_clock(ManualClock(unix_ns=1_420_070_400 * 10**9 + 1_000_000_000), path) as signing_clock:
        assert signing_clock.next() == 100_000


async def test_every_timestamp_is_later_than_all_before(clock, path):
    async with open_signing_clock(clock, path) as signing_clock:
        stamps = [signing_clock.next() for _ in range(100)]
        clock.jump(1.0)
        stamps += [signing_clock.next() for _ in range(100)]
        clock.jump(-3600.0)
        stamps += [signing_clock.next() for _ in range(100)]
    assert stamps[0] == NOW
    assert stamps[100] == NOW + UNITS_PER_S
    assert all(later > earlier for earlier, later in pairwise(stamps))


async def test_a_crash_repeats_no_timestamp_though_the_time_is_set_back(clock, path):
    async with open_signing_clock(clock, path) as signing_clock:
        used = [signing_clock.next() for _ in range(10)]
        left_by_a_crash = path.read_text()
    path.write_text(left_by_a_crash)
    async with open_signing_clock(ManualClock(unix_ns=FAKE_UNIX_NS - 10**15), path) as signing_clock:
        assert signing_clock.next() > max(used)


@pytest.mark.parametrize("step_s", [4.0, 30.0, 86_400.0])
async def test_nothing_is_handed_out_before_the_file_is_ahead_of_it(clock, path, step_s):
    """Even when the time jumps: until the writer has caught up, timestamps lag."""
    async with open_signing_clock(clock, path) as signing_clock:
        for _ in range(5):
            clock.jump(step_s)
            assert signing_clock.next() <= stored(path)
            await until(lambda: stored(path) > signing_clock.now())
            assert NOW < signing_clock.next() <= stored(path)
        await until(lambda: signing_clock.next() >= NOW + 5 * step_s * UNITS_PER_S)
        assert signing_clock.next() <= stored(path)


async def test_what_a_peer_says_is_run_on_from_once_the_file_is_ahead_of_it(clock, path):
    async with open_signing_clock(clock, path) as signing_clock:
        heard = NOW + 3600 * UNITS_PER_S
        signing_clock.hear(heard)
        assert signing_clock.next() <= stored(path)
        await until(lambda: signing_clock.next() >= heard)
        assert signing_clock.next() <= stored(path)


async def test_an_absurd_timestamp_leaves_room_to_count_on(clock, path):
    async with open_signing_clock(clock, path) as signing_clock:
        signing_clock.hear(2**48 - 1)
        await until(lambda: signing_clock.next() >= LATEST)
        assert LATEST < signing_clock.next() < signing_clock.next() < 2**48


async def test_a_clean_end_leaves_no_gap(clock, path):
    for _ in range(20):
        async with open_signing_clock(clock, path) as signing_clock:
            last = signing_clock.next()
        assert stored(path) == last
    assert last == NOW + 19


async def test_the_file_is_the_users_alone_and_nothing_else_is_left(clock, path):
    async with open_signing_clock(clock, path):
        assert path.stat().st_mode & 0o777 == 0o600
        assert path.parent.stat().st_mode & 0o777 == 0o700
    assert sorted(file.name for file in path.parent.iterdir()) == ["timestamp", "timestamp.lock"]


@pytest.mark.parametrize("content", ["", "soon", "-5", "1.5e12", "9" * 15, "9" * 5000, "١٢٣"])
async def test_a_damaged_file_is_said_and_replaced(clock, path, caplog, content):
    path.parent.mkdir()
    path.write_text(content)
    async with open_signing_clock(clock, path) as signing_clock:
        assert signing_clock.next() == NOW
    assert str(path) in caplog.text
    assert stored(path) == NOW


async def test_a_place_that_cannot_be_written_is_said_once_and_signing_goes_on(clock, tmp_path, caplog):
    (tmp_path / "file").write_text("")
    async with open_signing_clock(clock, tmp_path / "file" / "timestamp") as signing_clock:
        assert signing_clock.next() == NOW
        clock.jump(3600.0)
        assert signing_clock.next() == NOW + 3600 * UNITS_PER_S
    (record,) = caplog.records
    assert "the signing timestamp is not kept (File exists)" in record.message


async def test_a_place_lost_on_the_way_is_said_once_and_signing_goes_on(clock, path, caplog):
    async with open_signing_clock(clock, path) as signing_clock:
        for file in path.parent.iterdir():
            file.unlink()
        path.parent.rmdir()
        for _ in range(3):
            clock.jump(60.0)
            signing_clock.next()
            await until(lambda: caplog.records)
        await until(lambda: signing_clock.next() >= NOW + 180 * UNITS_PER_S)
    (record,) = caplog.records
    assert "is not kept (No such file or directory)" in record.message


async def test_a_disk_that_hangs_holds_nobody_up(clock, tmp_path):
    """The write never ends: timestamps lag within what the file had ahead, and still grow."""
    release = threading.Event()
    signing_clock = SigningClock(clock)
    await signing_clock.reserve(tmp_path / "timestamp")
    ahead = stored(tmp_path / "timestamp")
    asyncio.get_running_loop().set_default_executor(blocked := _Blocked(release))
    keeping = asyncio.create_task(signing_clock.keep_reserved(tmp_path / "timestamp"))
    clock.jump(3600.0)
    stamps = []
    for _ in range(1000):
        stamps.append(signing_clock.next())
        await asyncio.sleep(0)
    assert blocked.asked
    assert stamps[0] == ahead
    assert all(later == earlier + 1 for earlier, later in pairwise(stamps))
    release.set()
    await until(lambda: signing_clock.next() >= NOW + 3600 * UNITS_PER_S)
    keeping.cancel()


class _Blocked(ThreadPoolExecutor):
    """A thread whose work waits until it is released."""

    def __init__(self, release):
        super().__init__(max_workers=1)
        self.asked = 0
        self._release = release

    def submit(self, work, /, *arguments, **options):
        self.asked += 1

        def later():
            self._release.wait(PATIENCE_S)
            return work(*arguments, **options)

        return super().submit(later)


async def test_a_second_process_signs_beside_the_first_not_ahead_of_it(clock, path, caplog):
    async with open_signing_clock(clock, path) as first, open_signing_clock(clock, path) as second:
        assert "another process of this user signs" in caplog.text
        assert first.next() == second.next() == NOW
        ahead = stored(path)
        clock.jump(60.0)
        second.next()
        await settle()
        assert stored(path) == ahead, "the first process's file is its own"


def test_the_file_lives_in_the_users_state_directory(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert default_state_file() == tmp_path / "bearing-relay" / "signing-timestamp"
    monkeypatch.setenv("XDG_STATE_HOME", "relative/paths/are/ignored")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_state_file() == tmp_path / ".local" / "state" / "bearing-relay" / "signing-timestamp"
    monkeypatch.delenv("XDG_STATE_HOME")
    assert default_state_file() == tmp_path / ".local" / "state" / "bearing-relay" / "signing-timestamp"


STAMPING = """
import asyncio, pathlib, sys
from drivers.clock import SystemClock
from drivers.mavlink.signing_clock import open_signing_clock

async def main():
    async with open_signing_clock(SystemClock(), pathlib.Path(sys.argv[1])) as clock:
        while True:
            print(clock.next(), flush=True)
            await asyncio.sleep(0)

asyncio.run(main())
"""


@pytest.mark.slow
def test_a_process_that_is_killed_repeats_nothing(path):
    latest = 0
    for _ in range(3):
        process = subprocess.Popen([sys.executable, "-c", STAMPING, str(path)], stdout=subprocess.PIPE, text=True)
        first = int(process.stdout.readline())
        assert first > latest
        os.kill(process.pid, signal.SIGKILL)
        stamps = [first, *(int(line) for line in process.stdout.read().splitlines()[:-1])]
        process.stdout.close()
        process.wait()
        assert stamps == sorted(set(stamps))
        latest = max(stamps)
        assert stored(path) >= latest
