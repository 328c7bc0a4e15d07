"""A new router in the place of one that has gone: nobody hears anybody for a while, and what counts comes late."""

from __future__ import annotations

import pytest

from gcs.faults.bus import FaultyBus
from tests.fakes import ManualClock

BEARINGS, EMISSION = "bearing-relay/s/uav/U1/bearings", "bearing-relay/s/uav/U1/emission"
LONGEST_S = 4.1


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


def heard_on(bus: FaultyBus) -> list[tuple[str, bytes]]:
    heard: list[tuple[str, bytes]] = []
    for key in (BEARINGS, EMISSION):
        bus.subscribe(key, lambda *sample: heard.append(sample))
    return heard


async def test_a_new_router_is_there_before_anybody_is_heard_through_it(clock: ManualClock) -> None:
    bus = FaultyBus(clock, 3)
    heard = heard_on(bus)
    bus.go()
    bus.put_reliably(EMISSION, b"on")
    bus.start_anew()
    assert bus.connected()
    bus.put_latest(BEARINGS, b"lost")
    bus.put_reliably(EMISSION, b"off")
    bus.repeat()
    assert heard == []
    await clock.advance(LONGEST_S)
    bus.put_latest(BEARINGS, b"1")
    bus.repeat()
    bus.repeat()
    assert heard == [(BEARINGS, b"1"), (EMISSION, b"off")]


async def test_who_comes_back_later_than_the_service_does_so_in_its_own_time_by_the_seed(clock: ManualClock) -> None:
    async def apart_s(seed: int) -> float:
        bus = FaultyBus(clock, seed)
        heard, began_s = heard_on(bus), clock.now_s()
        bus.go()
        bus.start_anew()
        while not heard:
            await clock.advance(0.05)
            bus.put_latest(BEARINGS, b"")
        return clock.now_s() - began_s

    found = [await apart_s(seed) for seed in range(8)]
    assert max(found) < LONGEST_S
    assert max(found) - min(found) > 1.0
    assert await apart_s(3) == pytest.approx(found[3])


async def test_a_router_that_goes_again_before_anybody_was_back_keeps_what_counts(clock: ManualClock) -> None:
    bus = FaultyBus(clock, 3)
    heard = heard_on(bus)
    bus.go()
    bus.put_reliably(EMISSION, b"on")
    bus.start_anew()
    bus.go()
    await clock.advance(LONGEST_S)
    bus.repeat()
    assert heard == []
    bus.come_back()
    assert heard == [(EMISSION, b"on")]
