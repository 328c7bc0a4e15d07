"""What waits between zenoh's threads and the event loop: bounded, fair, counted, and taken in portions."""

import asyncio
from itertools import pairwise

import pytest

from drivers.bus.inbox import MOST_WAITING, MOST_WAITING_BYTES, Inbox
from drivers.bus.session import LARGEST_BYTES, BusEndpoint, open_bus
from drivers.simulation.launcher import free_tcp_port

PATIENCE_S = 10.0


class Taker:
    """A handler that notes what it gets."""

    def __init__(self):
        self.taken = []

    def __call__(self, key, payload):
        self.taken.append((key, payload))

    def of(self, key):
        return [payload for at, payload in self.taken if at == key]


@pytest.fixture
async def inbox():
    return Inbox(asyncio.get_running_loop())


async def delivered(inbox):
    """Let the loop take everything that waits, a portion in each of its rounds."""
    for _ in range(MOST_WAITING):
        await asyncio.sleep(0)
    assert not inbox.waiting


async def test_a_flood_while_the_loop_is_busy_waits_in_bounds_the_latest_wins_and_the_rest_is_counted(inbox):
    taker, most = Taker(), 0
    for number in range(200_000):
        inbox.hand_over(taker, f"uav/U{number % 10}/bearings", b"%d" % number)
        most = max(most, inbox.waiting)
    assert most == MOST_WAITING
    assert inbox.losses.overtaken == 200_000 - MOST_WAITING
    await delivered(inbox)
    assert len(taker.taken) == MOST_WAITING
    for uav in range(10):
        numbers = [int(payload) for payload in taker.of(f"uav/U{uav}/bearings")]
        assert numbers == list(range(numbers[0], 200_000, 10))
        assert numbers[-1] == 200_000 - 10 + uav


async def test_who_floods_one_key_loses_nothing_but_its_own(inbox):
    taker = Taker()
    for number in range(3 * MOST_WAITING):
        if number % 100 == 0:
            inbox.hand_over(taker, "uav/U1/bearings", b"%d" % number)
        inbox.hand_over(taker, "uav/Z/bearings", b"flood")
    await delivered(inbox)
    assert taker.of("uav/U1/bearings") == [b"%d" % number for number in range(0, 3 * MOST_WAITING, 100)]
    assert inbox.losses.overtaken == 3 * MOST_WAITING - len(taker.of("uav/Z/bearings"))


async def test_who_has_said_little_is_heard_before_a_flood_that_came_earlier(inbox):
    taker = Taker()
    for _ in range(MOST_WAITING):
        inbox.hand_over(taker, "uav/Z/bearings", b"flood")
    inbox.hand_over(taker, "uav/U1/bearings", b"measured")
    await delivered(inbox)
    assert ("uav/U1/bearings", b"measured") in taker.taken[:2]


async def test_ever_new_keys_cannot_make_it_grow_either(inbox):
    taker = Taker()
    for number in range(3 * MOST_WAITING):
        inbox.hand_over(taker, f"uav/X{number}/bearings", b"")
    assert inbox.waiting == MOST_WAITING
    await delivered(inbox)
    assert [key for key, _ in taker.taken] == [
        f"uav/X{number}/bearings" for number in range(2 * MOST_WAITING, 3 * MOST_WAITING)
    ]


async def test_large_samples_are_bounded_by_their_bytes(inbox):
    taker, size = Taker(), MOST_WAITING_BYTES // 4
    for number in range(9):
        inbox.hand_over(taker, f"uav/U{number % 2}/bearings", bytes([number]) * size)
    assert inbox.waiting == 4
    assert inbox.losses.overtaken == 5
    await delivered(inbox)
    assert sorted(payload[0] for _, payload in taker.taken) == [5, 6, 7, 8]


async def test_other_callbacks_have_their_turn_between_portions(inbox):
    taker, at = Taker(), []
    for _ in range(1000):
        inbox.hand_over(taker, "uav/Z/bearings", b"flood")
    for _ in range(5):
        await asyncio.sleep(0)
        at.append(len(taker.taken))
    assert at[-1] < 1000
    assert max(later - earlier for earlier, later in pairwise(at)) <= 100


async def test_one_handler_that_fails_takes_no_sample_with_it_and_is_told(inbox):
    told, taker = [], Taker()
    asyncio.get_running_loop().set_exception_handler(lambda _loop, context: told.append(context))

    def fail(key, payload):
        raise ValueError(key)

    for handler in (taker, fail, taker):
        inbox.hand_over(handler, "uav/U1/bearings", b"")
    await delivered(inbox)
    assert len(taker.taken) == 2
    assert [str(context["exception"]) for context in told] == ["uav/U1/bearings"]


async def test_whatever_threads_hand_over_is_delivered_or_counted(inbox):
    taker = Taker()

    def flood(name):
        for number in range(5000):
            inbox.hand_over(taker, f"uav/{name}/bearings", b"%d" % number)

    await asyncio.gather(*(asyncio.to_thread(flood, f"U{number}") for number in range(4)))
    await delivered(inbox)
    assert len(taker.taken) + inbox.losses.overtaken == 20_000
    for number in range(4):
        numbers = [int(payload) for payload in taker.of(f"uav/U{number}/bearings")]
        assert numbers == sorted(numbers)
        assert numbers[-1] == 4999


@pytest.mark.slow
async def test_what_is_too_large_for_the_bus_is_lost_alone():
    endpoint, taker = f"tcp/127.0.0.1:{free_tcp_port()}", Taker()
    async with open_bus(BusEndpoint(endpoint, role="router")) as service, open_bus(BusEndpoint(endpoint)) as stranger:
        service.subscribe("t/**", taker)
        async with asyncio.timeout(PATIENCE_S):
            while not taker.of("t/before"):
                stranger.put_latest("t/before", b"heard")
                await asyncio.sleep(0.01)
            stranger.put_reliably("t/large", b"[" * (LARGEST_BYTES + 1))
            while not taker.of("t/after"):
                stranger.put_latest("t/after", b"heard")
                await asyncio.sleep(0.01)
        assert not taker.of("t/large")
