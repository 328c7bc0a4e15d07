"""Bearing reports: the good are handed on, every other is counted under its own name and dropped."""

from __future__ import annotations

import asyncio
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.keys import SwarmKeys
from gcs.bearings import BearingFeed, collect
from planner.frames import FormationFrame
from tests.fakes import FakeBus, ManualClock

KEYS = SwarmKeys("test")
PSI = math.radians(30.0)


def a_report(clock: ManualClock, age_s: float = 0.1, **changes: object) -> bytes:
    report: dict[str, object] = {
        "captured_ns": clock.unix_ns() - round(age_s * 1e9),
        "sequence": 1,
        "reference": "true_north",
        "bearings": [{"transmitter": "L0", "azimuth_rad": 1.0, "sigma_rad": 0.01}],
    }
    return msgspec.json.encode(report | changes)


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def feed(clock: ManualClock) -> BearingFeed:
    return BearingFeed(["U1", "U2"], FormationFrame(PSI), clock, max_age_s=0.5)


async def test_a_good_report_becomes_an_observation_in_the_formation_frame(
    clock: ManualClock, feed: BearingFeed
) -> None:
    with feed.listen("U1") as observations:
        feed.take(KEYS.bearings("U1"), a_report(clock))
        observation = await observations.next(1.0)
    assert observation is not None
    assert observation.directions_rad == {"L0": pytest.approx(PSI - 1.0)}
    assert observation.sigma_rad == {"L0": 0.01}
    assert observation.captured_s == pytest.approx(clock.now_s() - 0.1)
    assert (feed.counters.received, feed.counters.stale, feed.counters.malformed) == (1, 0, 0)


@pytest.mark.parametrize(("age_s", "stale"), [(0.49, 0), (0.51, 1), (60.0, 1), (-0.49, 0), (-0.51, 1)])
def test_old_reports_and_reports_from_the_future_are_stale(
    clock: ManualClock, feed: BearingFeed, age_s: float, stale: int
) -> None:
    feed.take(KEYS.bearings("U1"), a_report(clock, age_s))
    assert feed.counters.stale == stale
    assert ("U1" in feed.latest) is (not stale)


def test_a_repeated_or_older_report_is_out_of_order(clock: ManualClock, feed: BearingFeed) -> None:
    for age_s in (0.2, 0.2, 0.3, 0.1):
        feed.take(KEYS.bearings("U1"), a_report(clock, age_s))
    assert feed.counters.out_of_order == 2
    feed.take(KEYS.bearings("U2"), a_report(clock, 0.3))  # another receiver has its own order
    assert feed.counters.out_of_order == 2


@pytest.mark.parametrize("sender", ["U9", "L0", "U1.x"])
def test_a_stranger_is_an_unknown_sender(clock: ManualClock, feed: BearingFeed, sender: str) -> None:
    feed.take(KEYS.bearings(sender), a_report(clock))
    assert feed.counters.unknown_sender == 1
    assert not feed.latest


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"{",
        b"[]",
        b'{"captured_ns": 1}',
        b'{"captured_ns": -1, "sequence": 0, "reference": "true_north", "bearings": []}',
        b'{"captured_ns": 1, "sequence": 0, "reference": "magnetic", "bearings": []}',
        b'{"captured_ns": 1, "sequence": 0, "reference": "true_north", "bearings": [{"transmitter": "L0"}]}',
    ],
)
def test_what_is_no_report_is_malformed(feed: BearingFeed, payload: bytes) -> None:
    feed.take(KEYS.bearings("U1"), payload)
    assert feed.counters.malformed == 1


def test_numbers_that_are_none_are_malformed(clock: ManualClock, feed: BearingFeed) -> None:
    for number in (b"NaN", b"1e400", b"Infinity"):
        feed.take(KEYS.bearings("U1"), a_report(clock).replace(b"1.0", number))
    assert feed.counters.malformed == 3


def test_bearings_without_a_heading_guide_nothing(clock: ManualClock, feed: BearingFeed) -> None:
    feed.take(KEYS.bearings("U1"), a_report(clock, reference="body"))
    assert feed.counters.malformed == 1
    assert not feed.latest


@given(st.binary(max_size=200), st.text(max_size=60))
def test_no_bytes_and_no_key_break_the_feed(payload: bytes, key: str) -> None:
    feed = BearingFeed(["U1"], FormationFrame(0.0), ManualClock(), 0.5)
    feed.take(key, payload)
    feed.take(KEYS.bearings("U1"), payload)
    assert feed.counters.received == 2


def test_it_takes_the_reports_of_its_own_swarm_off_the_bus(clock: ManualClock, feed: BearingFeed) -> None:
    bus = FakeBus()
    feed.attach(bus, KEYS)
    bus.put_latest(SwarmKeys("other").bearings("U1"), a_report(clock))
    assert feed.counters.received == 0
    bus.put_latest(KEYS.bearings("U1"), a_report(clock))
    assert feed.counters.received == 1


async def test_waiting_ends_with_the_next_report_or_the_time(clock: ManualClock, feed: BearingFeed) -> None:
    with feed.listen("U1") as observations:
        waiting = asyncio.create_task(observations.next(0.5))
        await clock.advance(0.4)
        assert not waiting.done()
        await clock.advance(0.2)
        assert await waiting is None
        waiting = asyncio.create_task(observations.next(0.5))
        await clock.advance(0.1)
        feed.take(KEYS.bearings("U1"), a_report(clock))
        await clock.advance(0.0)
        assert await waiting is not None


async def test_collecting_skips_reports_that_lack_a_transmitter_and_gives_up(
    clock: ManualClock, feed: BearingFeed
) -> None:
    with feed.listen("U1") as observations:
        for k in range(20):
            feed.take(KEYS.bearings("U1"), a_report(clock, 0.4 - k * 0.01))
        assert len(await collect(observations, 5, ["L0"], 0.5)) == 5
        assert await collect(observations, 2, ["L0", "L1"], 0.5) == []


def test_nobody_listens_after_the_block(clock: ManualClock, feed: BearingFeed) -> None:
    with feed.listen("U1") as observations:
        pass
    feed.take(KEYS.bearings("U1"), a_report(clock))
    assert not observations._waiting
