"""Background tasks end with their block, and their failure ends it."""

import asyncio

import pytest

from drivers.tasks import background, open_background


class LostError(Exception):
    pass


async def forever(ended):
    try:
        await asyncio.Event().wait()
    finally:
        ended.append("ended")


async def failing():
    raise LostError


async def test_they_run_beside_the_body_and_end_with_it():
    ended = []
    async with background(forever(ended), forever(ended)):
        await asyncio.sleep(0)
        assert ended == []
    assert ended == ["ended", "ended"]


async def test_a_failing_body_ends_them_and_its_error_comes_out():
    async def body():
        async with background(forever(ended)):
            await asyncio.sleep(0)
            raise LostError

    ended = []
    with pytest.raises(ExceptionGroup) as caught:
        await body()
    assert caught.group_contains(LostError)
    assert ended == ["ended"]


async def test_a_failing_task_ends_the_body_and_the_other_tasks():
    ended = []
    with pytest.raises(ExceptionGroup) as caught:
        async with background(forever(ended), failing()):
            await asyncio.wait_for(asyncio.Event().wait(), 5.0)
    assert caught.group_contains(LostError)
    assert ended == ["ended"]


async def test_a_task_that_ends_by_itself_leaves_the_body_running():
    async def short():
        await asyncio.sleep(0)

    async with background(short()):
        for _ in range(5):
            await asyncio.sleep(0)


async def test_tasks_started_during_the_body_end_with_it():
    ended = []
    async with open_background() as start:
        start(forever(ended))
        await asyncio.sleep(0)
        start(forever(ended))
        await asyncio.sleep(0)
        assert ended == []
    assert ended == ["ended", "ended"]


async def test_the_failure_of_a_task_started_during_the_body_ends_it():
    async def body():
        async with open_background() as start:
            start(failing())
            await asyncio.wait_for(asyncio.Event().wait(), 5.0)

    with pytest.raises(ExceptionGroup) as caught:
        await body()
    assert caught.group_contains(LostError)
