"""The clocks: the machine's, the same run faster, and the one tests move by hand."""

import asyncio
import time

import pytest

from drivers.clock import SystemClock
from tests.fakes import ManualClock, settle

EPOCH_NS = 1_900_000_000_000_000_000


def test_the_systems_clock_is_the_machines():
    clock = SystemClock()
    before_s, before_ns = time.monotonic(), time.time_ns()
    now_s, unix_ns = clock.now_s(), clock.unix_ns()
    assert before_s <= now_s <= time.monotonic()
    assert before_ns <= unix_ns <= time.time_ns()


def test_a_fast_clock_runs_as_many_times_as_fast():
    clock = SystemClock(speedup=50.0, epoch_ns=time.time_ns())
    before_s, now_s, unix_ns, between_s = time.monotonic(), clock.now_s(), clock.unix_ns(), time.monotonic()
    time.sleep(0.02)
    until_s, now_s, unix_ns = time.monotonic(), clock.now_s() - now_s, clock.unix_ns() - unix_ns
    after_s = time.monotonic()
    for passed_s in (now_s, unix_ns * 1e-9):
        assert 50 * (until_s - between_s) - 1e-3 <= passed_s <= 50 * (after_s - before_s) + 1e-3


def test_a_fast_clock_starts_from_its_epoch_so_that_processes_given_the_same_agree():
    epoch_ns = time.time_ns() - 1_000_000_000
    first, second = SystemClock(10.0, epoch_ns), SystemClock(10.0, epoch_ns)
    earlier_ns, between_ns, later_ns = first.unix_ns(), second.unix_ns(), first.unix_ns()
    assert earlier_ns - epoch_ns >= 10_000_000_000
    assert earlier_ns - 1_000_000 <= between_ns <= later_ns + 1_000_000


async def test_sleeping_takes_the_clocks_time_not_the_machines():
    started_s = time.monotonic()
    clock = SystemClock(speedup=1000.0, epoch_ns=time.time_ns())
    slept_from_s = clock.now_s()
    await clock.sleep(10.0)
    assert clock.now_s() - slept_from_s >= 9.9
    assert time.monotonic() - started_s < 5.0


@pytest.mark.parametrize("duration_s", [0.0, -1.0, -1e9])
async def test_sleeping_for_no_time_only_lets_the_others_run(duration_s):
    others = []
    asyncio.get_running_loop().call_soon(others.append, "ran")
    await asyncio.wait_for(SystemClock().sleep(duration_s), 20.0)
    assert others == ["ran"]


async def test_the_manual_clock_wakes_sleepers_in_order_each_at_its_own_time():
    clock, woken = ManualClock(now_s=0.0, unix_ns=EPOCH_NS), []

    async def sleeper(name, *durations_s):
        for duration_s in durations_s:
            await clock.sleep(duration_s)
            woken.append((name, clock.now_s(), clock.unix_ns() - EPOCH_NS))

    async with asyncio.TaskGroup() as group:
        group.create_task(sleeper("slow", 3.0))
        group.create_task(sleeper("fast", 1.0, 1.0, 0.5))
        await clock.advance(2.5)
        assert woken == [
            ("fast", 1.0, 1_000_000_000),
            ("fast", 2.0, 2_000_000_000),
            ("fast", 2.5, 2_500_000_000),
        ]
        assert (clock.now_s(), clock.sleeping) == (2.5, 1)
        await clock.advance(0.5)
    assert woken[-1] == ("slow", 3.0, 3_000_000_000)


async def test_the_manual_clock_stands_still_by_itself_and_forgets_the_cancelled():
    clock = ManualClock()
    sleeper = asyncio.create_task(clock.sleep(1.0))
    await settle()
    assert (sleeper.done(), clock.sleeping) == (False, 1)
    sleeper.cancel()
    await settle()
    assert clock.sleeping == 0
    await clock.advance(5.0)


async def test_after_a_jump_the_manual_clock_wakes_the_overdue_late():
    clock, woken = ManualClock(now_s=0.0), []

    async def sleeper():
        await clock.sleep(1.0)
        woken.append(clock.now_s())

    task = asyncio.create_task(sleeper())
    await settle()
    clock.jump(4.0)
    await settle()
    assert woken == []
    await clock.advance(0.0)
    assert woken == [4.0]
    await task
