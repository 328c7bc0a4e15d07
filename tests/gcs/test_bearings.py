"""Bearing reports: the good are handed on, every other is counted under its own name and dropped."""

from __future__ import annotations

import asyncio
import math
from dataclasses import asdict

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import LEAST_SIGMA_RAD
from gcs.bearings import BearingFeed
from gcs.report_checks import STUCK_AFTER, BearingCounters
from planner.angles import wrap
from planner.frames import FormationFrame
from tests.fakes import FakeBus, ManualClock

KEYS = SwarmKeys("test")
PSI = math.radians(30.0)


def a_report(clock: ManualClock, age_s: float = 0.1, **changes: object) -> bytes:
    report: dict[str, object] = {
        "captured_ns": clock.unix_ns() - round(age_s * 1e9),
        "sequence": 1,
        "reference": "true_north",
        "bearings": [a_bearing()],
    }
    return msgspec.json.encode(report | changes)


def a_bearing(azimuth_rad: float = 1.0, transmitter: str = "L0", sigma_rad: float = 0.01) -> dict[str, object]:
    return {"transmitter": transmitter, "azimuth_rad": azimuth_rad, "sigma_rad": sigma_rad}


def dropped(counters: BearingCounters) -> dict[str, int]:
    """What was dropped, by reason."""
    return {name: count for name, count in asdict(counters).items() if count and name != "received"}


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


@pytest.mark.parametrize(
    ("age_s", "problem"),
    [
        (0.49, None),
        (0.51, "stale"),
        (60.0, "stale"),
        (-0.49, None),
        (-0.51, "from_the_future"),
        (-9e3, "from_the_future"),
    ],
)
def test_old_reports_and_reports_from_the_future_are_dropped(
    clock: ManualClock, feed: BearingFeed, age_s: float, problem: str | None
) -> None:
    feed.take(KEYS.bearings("U1"), a_report(clock, age_s))
    assert dropped(feed.counters) == ({problem: 1} if problem else {})
    assert ("U1" in feed.latest) is (problem is None)


def test_a_report_seems_to_come_from_the_future_and_is_captured_now(clock: ManualClock, feed: BearingFeed) -> None:
    feed.take(KEYS.bearings("U1"), a_report(clock, -0.3))
    assert feed.latest["U1"].captured_s == clock.now_s()


def test_a_repeated_report_is_a_duplicate_and_an_older_one_out_of_order(clock: ManualClock, feed: BearingFeed) -> None:
    for age_s in (0.2, 0.2, 0.3, 0.3, 0.1):
        feed.take(KEYS.bearings("U1"), a_report(clock, age_s))
    assert dropped(feed.counters) == {"duplicate": 2, "out_of_order": 1}
    feed.take(KEYS.bearings("U1"), a_report(clock, 0.1, sequence=2))  # another report of the same instant
    assert dropped(feed.counters) == {"duplicate": 2, "out_of_order": 2}
    feed.take(KEYS.bearings("U2"), a_report(clock, 0.3))  # another receiver has its own order
    assert dropped(feed.by_receiver["U1"]) == {"duplicate": 2, "out_of_order": 2}
    assert dropped(feed.by_receiver["U2"]) == {}
    assert (feed.by_receiver["U1"].received, feed.by_receiver["U2"].received, feed.counters.received) == (6, 1, 7)


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


def test_two_bearings_of_one_transmitter_are_malformed(clock: ManualClock, feed: BearingFeed) -> None:
    feed.take(KEYS.bearings("U1"), a_report(clock, bearings=[a_bearing(1.0), a_bearing(1.3)]))
    assert dropped(feed.counters) == {"malformed": 1}
    assert not feed.latest


def test_bearings_without_a_heading_guide_nothing(clock: ManualClock, feed: BearingFeed) -> None:
    feed.take(KEYS.bearings("U1"), a_report(clock, reference="body"))
    assert dropped(feed.counters) == {"without_heading": 1}
    assert not feed.latest


@given(*[st.floats(-math.pi, math.pi)] * 3)
def test_body_referenced_bearings_are_marked_and_keep_their_subtended_angles(
    first_rad: float, second_rad: float, heading_rad: float
) -> None:
    """The angle between two transmitters is the same whether the sensor knows where north is or not."""
    clock = ManualClock()
    feed = BearingFeed(["U1", "U2"], FormationFrame(PSI), clock, max_age_s=0.5, reference="body")
    for receiver, turned_rad, reference in (("U1", 0.0, "true_north"), ("U2", heading_rad, "body")):
        azimuths = {"L0": first_rad - turned_rad, "L1": second_rad - turned_rad}
        bearings = [a_bearing(math.remainder(azimuth, math.tau), name) for name, azimuth in azimuths.items()]
        feed.take(KEYS.bearings(receiver), a_report(clock, reference=reference, bearings=bearings))
    north, body = feed.latest["U1"], feed.latest["U2"]
    assert (north.reference, body.reference) == ("true_north", "body")
    subtended = [wrap(seen.directions_rad["L1"] - seen.directions_rad["L0"]) for seen in (north, body)]
    assert wrap(subtended[0] - subtended[1]) == pytest.approx(0.0, abs=1e-9)
    assert wrap(body.directions_rad["L0"] + first_rad - heading_rad) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("step_rad", [0.0, 0.0175])
def test_what_the_sensor_rounds_to_is_handed_on(clock: ManualClock, feed: BearingFeed, step_rad: float) -> None:
    feed.take(KEYS.bearings("U1"), a_report(clock, resolution_rad=step_rad))
    assert feed.latest["U1"].resolution_rad == step_rad


@pytest.mark.parametrize(
    ("changes", "stuck"),
    [
        ({}, 8 - STUCK_AFTER + 1),
        ({"bearings": [a_bearing(1.0), a_bearing(2.0, "L1")]}, 8 - STUCK_AFTER + 1),
        ({"bearings": [a_bearing(sigma_rad=LEAST_SIGMA_RAD)]}, 0),  # free of noise
        ({"resolution_rad": 0.0175}, 0),  # it shows whole degrees
        ({"bearings": []}, 0),
    ],
)
def test_a_sensor_that_shows_the_same_to_the_last_bit_is_stuck(
    clock: ManualClock, feed: BearingFeed, changes: dict[str, object], stuck: int
) -> None:
    for k in range(8):
        feed.take(KEYS.bearings("U1"), a_report(clock, 0.4 - k * 0.01, sequence=k, **changes))
    assert dropped(feed.counters) == ({"stuck": stuck} if stuck else {})
    feed.take(KEYS.bearings("U1"), a_report(clock, 0.1, sequence=9, bearings=[a_bearing(1.0000000001)]))
    assert feed.counters.stuck == stuck
    assert feed.latest["U1"].captured_s == pytest.approx(clock.now_s() - 0.1)


def test_one_bearing_that_repeats_itself_beside_one_that_does_not_is_no_stuck_sensor(
    clock: ManualClock, feed: BearingFeed
) -> None:
    for k in range(20):
        bearings = [a_bearing(1.0), a_bearing(2.0 + k * 1e-9, "L1")]
        feed.take(KEYS.bearings("U1"), a_report(clock, 0.4 - k * 0.01, sequence=k, bearings=bearings))
    assert dropped(feed.counters) == {}


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


async def test_what_has_waited_too_long_for_its_reader_is_no_fresh_bearing_any_more(
    clock: ManualClock, feed: BearingFeed
) -> None:
    with feed.listen("U1") as observations:
        feed.take(KEYS.bearings("U1"), a_report(clock))
        clock.jump(0.3)
        feed.take(KEYS.bearings("U1"), a_report(clock, bearings=[a_bearing(1.1)]))
        clock.jump(0.3)
        observation = await observations.next(0.5)
        assert observation is not None
        assert clock.now_s() - observation.captured_s == pytest.approx(0.4)
        feed.take(KEYS.bearings("U1"), a_report(clock, bearings=[a_bearing(1.2)]))
        clock.jump(0.5)
        waiting = asyncio.create_task(observations.next(0.5))
        await clock.advance(0.6)
        assert await waiting is None
    assert feed.counters.stale == 2


def test_nobody_listens_after_the_block(clock: ManualClock, feed: BearingFeed) -> None:
    with feed.listen("U1") as observations:
        pass
    feed.take(KEYS.bearings("U1"), a_report(clock))
    assert not observations._waiting
