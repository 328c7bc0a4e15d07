"""Virtual time passes only when nothing can run, and to the exact moment the next thing is due."""

from __future__ import annotations

import asyncio
import time

import pytest

from gcs.simulate.virtual_time import VirtualClock, run_virtually


def test_sleeping_takes_virtual_time_and_no_other() -> None:
    clock = VirtualClock()

    async def sleep() -> tuple[float, int]:
        await clock.sleep(3600.0)
        return clock.now_s(), clock.unix_ns()

    before_s = time.monotonic()
    now_s, unix_ns = run_virtually(sleep())
    assert now_s == pytest.approx(3600.0)
    assert time.monotonic() - before_s < 5.0

    async def begin() -> int:
        return clock.unix_ns()

    assert unix_ns - run_virtually(begin()) == pytest.approx(3600e9)


def test_sleepers_wake_in_order_each_at_its_time() -> None:
    clock, woken = VirtualClock(), []

    async def sleeper(duration_s: float) -> None:
        await clock.sleep(duration_s)
        woken.append((duration_s, clock.now_s()))

    async def everybody() -> None:
        async with asyncio.TaskGroup() as group:
            for duration_s in (0.3, 0.1, 0.2, 0.1, 0.0, -1.0):
                group.create_task(sleeper(duration_s))

    run_virtually(everybody())
    assert [duration_s for duration_s, _ in woken] == [0.0, -1.0, 0.1, 0.1, 0.2, 0.3]
    assert all(at_s == pytest.approx(max(duration_s, 0.0)) for duration_s, at_s in woken)


def test_who_waits_for_ever_is_an_error_not_a_hang() -> None:
    async def wait() -> None:
        await asyncio.get_running_loop().create_future()

    with pytest.raises(RuntimeError, match="nothing is due any more"):
        run_virtually(wait())
