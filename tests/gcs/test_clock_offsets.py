"""Clocks of the sensors: whatever they show, a report is as old as it is, and one that is too old is never taken."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aoa.model import ClockFault, SensorFaults
from drivers.aoa.simulated import SensorSettings
from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import (
    Bearing,
    BearingReport,
    ClockPing,
    ClockPong,
    Emission,
    PositionReport,
    decode,
    encode,
)
from drivers.bus.session import BusEndpoint, open_bus
from drivers.clock import SystemClock
from drivers.simulation.launcher import free_tcp_port, process_group
from drivers.tasks import background
from gcs.bearings import BearingFeed
from gcs.clock_offsets import DRIFT_PER_S, PING_EVERY_S, ClockOffsets, SensorClock
from planner.frames import FormationFrame
from tests.fakes import FAKE_UNIX_NS, FakeBus, ManualClock, settle

KEYS = SwarmKeys("test")
HOUR_S = 3600.0


class Uav:
    """A UAV with a clock of its own, at the end of a path that takes its time in either direction."""

    def __init__(self, world: World, name: str, ahead_s: float = 0.0) -> None:
        self.world, self.name = world, name
        self.ahead_s = ahead_s
        self.drift = 0.0
        self.answers = True
        self.clock_name = ""
        self.delays_s = lambda: (0.0, 0.0)
        self.sequence = 0
        world.bus.subscribe(KEYS.clock_ping(name), self._pinged)

    def clock_ns(self, at_s: float) -> int:
        passed_s = at_s - self.world.started_s
        return FAKE_UNIX_NS + round((passed_s * (1.0 + self.drift) + self.ahead_s) * 1e9)

    def _pinged(self, key: str, payload: bytes) -> None:
        if self.answers:
            there_s, back_s = self.delays_s()
            self.world.later(there_s, lambda: self._answer(decode(payload, ClockPing), back_s))

    def _answer(self, ping: ClockPing, back_s: float) -> None:
        read_ns = self.clock_ns(self.world.clock.now_s())
        pong = encode(ClockPong(ping.asked_ns, read_ns, read_ns, self.clock_name))
        self.world.later(back_s, lambda: self.world.bus.put_latest(KEYS.clock_pong(self.name), pong))

    def report(self, age_s: float = 0.1, clock: str = "") -> None:
        """Send a report that was captured `age_s` ago in truth."""
        self.sequence += 1
        captured_ns = self.clock_ns(self.world.clock.now_s() - age_s)
        bearings = [Bearing("L0", 0.001 * self.sequence, 0.01)]
        report = BearingReport(captured_ns, self.sequence, "true_north", bearings, clock=clock)
        self.world.bus.put_latest(KEYS.bearings(self.name), encode(report))


class World:
    """A service that listens to U1 and U2, in virtual time."""

    def __init__(self) -> None:
        self.clock, self.bus, self.said = ManualClock(), FakeBus(), []
        self.started_s = self.clock.now_s()
        self.clocks = ClockOffsets(["U1", "U2"], self.clock, self.said.append)
        self.clocks.attach(self.bus, KEYS)
        self.feed = BearingFeed(["U1", "U2"], FormationFrame(0.0), self.clock, 0.5, self.clocks)
        self.feed.attach(self.bus, KEYS)
        self.running: set[asyncio.Task[None]] = set()

    def later(self, delay_s: float, act) -> None:
        async def wait() -> None:
            await self.clock.sleep(delay_s)
            act()

        if delay_s == 0.0:
            act()
        else:
            self.running.add(asyncio.ensure_future(wait()))

    def age_s(self, name: str = "U1") -> float:
        """How old the latest observation of a receiver is, as the service sees it."""
        return self.clock.now_s() - self.feed.latest[name].captured_s

    def dropped(self, name: str = "U1") -> dict[str, int]:
        return {kind: n for kind, n in vars(self.feed.by_receiver[name]).items() if n and kind != "received"}


@pytest.fixture
async def world():
    world = World()
    pinging = asyncio.create_task(world.clocks.run())
    await settle()
    yield world
    for task in (pinging, *world.running):
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@pytest.mark.parametrize("ahead_s", [0.0, 2.5, -2.5, 5 * HOUR_S, -5 * HOUR_S, -50 * 365 * 24 * HOUR_S])
async def test_a_clock_that_is_off_by_seconds_or_by_years_makes_no_report_older_or_younger(world, ahead_s):
    uav = Uav(world, "U1", ahead_s)
    await world.clock.advance(2.5)
    uav.report(age_s=0.1)
    assert world.age_s() == pytest.approx(0.1, abs=2e-3)
    assert world.feed.latest["U1"].captured_uncertainty_s < 2e-3
    uav.report(age_s=0.7)
    assert world.dropped() == {"stale": 1}
    offset_s, uncertainty_s = world.clocks.offset_s("U1")
    assert offset_s == pytest.approx(ahead_s, abs=2e-3)
    assert uncertainty_s < 2e-3
    expected = (
        f"the clock of U1's sensor is {abs(ahead_s):.3f} s {'ahead' if ahead_s > 0 else 'behind'}: taken into account"
    )
    assert world.said == ([expected] if ahead_s else [])


async def test_without_an_answer_the_clock_is_taken_to_be_right_and_that_is_said_once(world):
    uav = Uav(world, "U1")
    uav.answers = False
    for _ in range(100):
        uav.report(age_s=0.1)
        await world.clock.advance(0.1)
    assert world.age_s() == pytest.approx(0.1 + 0.1)
    assert world.feed.latest["U1"].captured_uncertainty_s == 0.0
    assert world.dropped() == {}
    assert world.said == ["the sensor of U1 answers no clock pings: its capture times are taken as they are"]
    assert world.clocks.offset_s("U1") is None


async def test_a_clock_that_is_hours_off_and_does_not_answer_gives_no_observation(world):
    uav = Uav(world, "U1", HOUR_S)
    other = Uav(world, "U2", -HOUR_S)
    uav.answers = other.answers = False
    for _ in range(50):
        uav.report()
        other.report()
        await world.clock.advance(0.1)
    assert world.dropped("U1") == {"from_the_future": 50}
    assert world.dropped("U2") == {"stale": 50}
    assert not world.feed.latest


@pytest.mark.parametrize("step_s", [3.0, -3.0, 0.3, -0.45, HOUR_S, -HOUR_S])
async def test_a_clock_that_is_set_in_mid_run_costs_a_few_reports(world, step_s):
    uav = Uav(world, "U1", 1.0)
    uav.delays_s = lambda: (0.004, 0.006)

    async def fly(duration_s: float) -> None:
        for _ in range(round(duration_s / 0.1)):
            uav.report(age_s=0.1)
            await world.clock.advance(0.1)

    await world.clock.advance(1.5)
    await fly(20.0)
    assert world.dropped() == {}
    uav.ahead_s += step_s
    await fly(20.0)
    assert sum(world.dropped().values()) <= 4
    assert world.age_s() == pytest.approx(0.1 + 0.1, abs=0.02)
    assert len(world.said) == 2
    seconds = float(world.said[1].split(" was set ")[1].split()[0])
    assert seconds == pytest.approx(abs(step_s), abs=0.02)
    assert world.said[1].endswith("forward" if step_s > 0 else "back")


async def test_a_wall_clock_that_is_set_on_the_ground_moves_no_capture_time(world):
    uav = Uav(world, "U1", 7.0)
    await world.clock.advance(5.0)
    world.clock._started_ns += round(HOUR_S * 1e9)
    uav.report(age_s=0.2)
    assert world.age_s() == pytest.approx(0.2, abs=5e-3)
    assert world.dropped() == {}


async def test_reports_from_the_future_are_dropped_as_soon_as_the_clock_is_known(world):
    uav = Uav(world, "U1")
    await world.clock.advance(2.0)
    uav.report(age_s=-0.1)
    assert world.dropped() == {"from_the_future": 1}


async def test_a_report_must_be_fresh_beyond_the_doubt_about_its_clock(world):
    uav = Uav(world, "U1")
    uav.delays_s = lambda: (0.1, 0.1)
    await world.clock.advance(3.0)
    uav.report(age_s=0.45)
    assert world.dropped() == {"stale": 1}
    uav.report(age_s=0.35)
    assert world.age_s() == pytest.approx(0.35, abs=0.1)


async def test_a_clock_of_another_name_than_the_one_that_answers_is_taken_as_it_is(world):
    uav = Uav(world, "U1", 0.3)
    uav.clock_name = "companion"
    await world.clock.advance(2.0)
    uav.report(age_s=0.35, clock="companion")
    assert world.age_s() == pytest.approx(0.35, abs=5e-3)
    uav.report(age_s=0.34)  # it does not say by which: the one that answers
    assert world.age_s() == pytest.approx(0.34, abs=5e-3)
    uav.report(age_s=0.33, clock="radio")
    assert world.age_s() == pytest.approx(0.03, abs=5e-3)
    uav.report(age_s=0.32, clock="radio")
    said = "the sensor of U1 answers for the clock 'companion', not 'radio': its capture times are taken as they are"
    assert world.said.count(said) == 1


async def test_the_exchange_with_the_shortest_round_trip_counts_and_drift_ages_it(world):
    """A queue in one direction shifts the middle of an exchange; the undisturbed exchanges are not shifted."""
    uav, draw = Uav(world, "U1", 12.0), random.Random(1)
    uav.drift = 50e-6
    uav.delays_s = lambda: (0.002 + (draw.random() < 0.8) * draw.uniform(0.05, 0.4), 0.002)
    worst_s = 0.0
    for second in range(120):
        await world.clock.advance(1.0)
        if second > 15:
            offset_s, uncertainty_s = world.clocks.offset_s("U1")
            true_s = 12.0 + uav.drift * (world.clock.now_s() - world.started_s)
            assert abs(offset_s - true_s) <= uncertainty_s
            worst_s = max(worst_s, abs(offset_s - true_s))
    assert worst_s < 0.005
    assert len(world.said) == 1  # no clock was set


@given(
    ahead_s=st.floats(-1e7, 1e7),
    drift=st.floats(-0.9 * DRIFT_PER_S, 0.9 * DRIFT_PER_S),
    delays_s=st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 2.0)), min_size=1, max_size=40),
)
def test_the_true_offset_is_within_the_bound_and_no_drifting_clock_seems_to_have_been_set(ahead_s, drift, delays_s):
    known, now_s = SensorClock(), 1000.0

    def shows_ns(at_s: float) -> int:
        return FAKE_UNIX_NS + round((ahead_s + at_s * (1.0 + drift)) * 1e9)

    for number, (there_s, back_s) in enumerate(delays_s):
        known.ask(number, now_s)
        read_ns = shows_ns(now_s + there_s)
        now_s += there_s + back_s
        assert known.take(ClockPong(number, read_ns, read_ns), now_s) is None
        assert known.best is not None
        off_s = (shows_ns(now_s) - round(now_s * 1e9) - known.best.ahead_ns) * 1e-9
        assert abs(off_s) <= known.best.uncertainty_s(now_s) + 2e-6
        now_s += PING_EVERY_S


async def test_answers_nobody_asked_for_and_answers_that_come_twice_change_nothing(world):
    uav = Uav(world, "U1")
    await world.clock.advance(2.0)
    before = world.clocks.clocks["U1"].best
    asked_ns = decode(world.bus.payloads(KEYS.clock_ping("U1"))[-1], ClockPing).asked_ns
    far_ns = uav.clock_ns(world.clock.now_s()) + round(9e9)
    for pong in (
        ClockPong(asked_ns, far_ns, far_ns),  # has been answered
        ClockPong(asked_ns + 17, far_ns, far_ns),
    ):
        world.bus.put_latest(KEYS.clock_pong("U1"), encode(pong))
    for payload in (b"", b"{}", b"\xff", b'{"asked_ns":-1,"received_ns":0,"answered_ns":0}'):
        world.bus.put_latest(KEYS.clock_pong("U1"), payload)
        world.bus.put_latest(KEYS.clock_pong("stranger"), payload)
    assert world.clocks.clocks["U1"].best == before


@pytest.mark.parametrize(("received_s", "answered_s"), [(0.0, -0.1), (0.0, 5.0)])
def test_an_exchange_in_which_the_clock_was_set_says_nothing(received_s, answered_s):
    known = SensorClock()
    known.ask(1, 10.0)
    pong = ClockPong(1, FAKE_UNIX_NS + round(received_s * 1e9), FAKE_UNIX_NS + round(answered_s * 1e9))
    assert known.take(pong, 10.1) is None
    assert known.best is None


async def test_each_sensor_is_asked_once_a_round_and_at_most_ten_times_a_second_when_its_reports_look_wrong(world):
    uav = Uav(world, "U1")
    started = len(world.bus.payloads(KEYS.clock_ping("U1")))
    await world.clock.advance(10.0)
    assert len(world.bus.payloads(KEYS.clock_ping("U1"))) - started == pytest.approx(10.0 / PING_EVERY_S, abs=1)
    before = len(world.bus.payloads(KEYS.clock_ping("U1")))
    for _ in range(200):  # at 200 Hz, always stale
        uav.report(age_s=3.0)
        await world.clock.advance(0.005)
    assert len(world.bus.payloads(KEYS.clock_ping("U1"))) - before <= 12


async def test_a_bus_that_comes_and_goes_leaves_the_estimate_to_age(world):
    uav = Uav(world, "U1", 4.0)
    await world.clock.advance(3.0)
    world.bus.up = False
    await world.clock.advance(100.0)
    world.bus.up = True
    uav.report(age_s=0.1)
    assert world.age_s() == pytest.approx(0.1, abs=5e-3)
    assert world.clocks.offset_s("U1")[1] == pytest.approx(100.0 * DRIFT_PER_S, rel=0.1)


@given(st.binary(max_size=100), st.text(max_size=60))
def test_no_bytes_and_no_key_break_the_clocks(payload, key):
    clocks = ClockOffsets(["U1"], ManualClock())
    clocks.take(key, payload)
    clocks.take(KEYS.clock_pong("U1"), payload)
    assert clocks.clocks["U1"].best is None


def test_the_messages_are_the_published_ones():
    assert uav_of(KEYS.clock_ping("U1")) == uav_of(KEYS.clock_pong("U1")) == "U1"
    assert msgspec.json.decode(encode(ClockPing(17))) == {"asked_ns": 17}
    assert msgspec.json.decode(encode(ClockPong(1, 2, 3))) == {"asked_ns": 1, "received_ns": 2, "answered_ns": 3}


@pytest.mark.slow
async def test_over_a_real_bus_a_clock_an_hour_ahead_that_is_set_back_in_mid_run(tmp_path):
    """The sensors' process answers for its UAV's clock; every report handed out is as old as its latency."""
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    faults = SensorFaults(clock=ClockFault(offset_s=HOUR_S, step_s=-HOUR_S - 2.0, step_after_s=3.0))
    settings = SensorSettings(
        swarm="test", endpoint=endpoint, receivers=["U1"], beacons={"L0": (0.0, 0.0)}, sigma_rad=0.01, rate_hz=20.0,
        latency_s=0.15, drop_out=0.0, seed=1, speedup=1.0, epoch_ns=0, parent_pid=os.getpid(), faults={"U1": faults},
    )  # fmt: skip
    clock, said, ages_s = SystemClock(), [], []
    clocks = ClockOffsets(["U1"], clock, said.append)
    feed = BearingFeed(["U1"], FormationFrame(0.0), clock, 0.5, clocks)
    async with open_bus(BusEndpoint(endpoint, role="router")) as bus, process_group(tmp_path) as group:
        clocks.attach(bus, KEYS)
        feed.attach(bus, KEYS)
        bus.put_reliably(KEYS.emission("L0"), encode(Emission(on=True)))
        await group.start("sensors", ["-m", "drivers.aoa.simulated"], stdin=msgspec.json.encode(settings))
        with feed.listen("U1") as observations:
            async with background(clocks.run()):
                deadline_s = clock.now_s() + 20.0
                while len(said) < 2 or len(ages_s) < 100:
                    assert clock.now_s() < deadline_s, (said, len(ages_s), feed.counters)
                    bus.put_latest(
                        KEYS.position("U1"), encode(PositionReport(clock.unix_ns(), 9.0, 0.0, -9.0, 0.0, 0.0))
                    )
                    if (seen := await observations.next(0.1)) is not None:
                        ages_s.append(clock.now_s() - seen.captured_s)
    ahead_s, back_s = (float(sentence.split(" s ")[0].split()[-1]) for sentence in said)
    assert (ahead_s, back_s) == (pytest.approx(HOUR_S, abs=0.2), pytest.approx(HOUR_S + 2.0, abs=0.2))
    assert "ahead" in said[0]
    assert "back" in said[1]
    assert min(ages_s) > 0.05
    assert sorted(ages_s)[len(ages_s) // 2] == pytest.approx(0.15, abs=0.05)
    assert feed.counters.stale <= 20  # from the setting of the clock to the answer that tells of it
