"""What runs a sensor on a UAV: its reports on the bus, answers for its clock, and a word on how it does."""

import asyncio
import contextlib
from collections import Counter

import pytest

from drivers.aoa.host import TOLD_EVERY_S, SensorHost
from drivers.aoa.kinds import SENSORS, read_settings
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Bearing, BearingReport, ClockPing, ClockPong, decode, encode
from drivers.errors import SensorError
from gcs.bearings import BearingFeed
from gcs.clock_offsets import ClockOffsets
from planner.frames import FormationFrame
from tests.fakes import FakeBus, ManualClock, settle

KEYS = SwarmKeys("test")


class OneBearing:
    """A sensor that measures one bearing ten times a second."""

    def __init__(self, clock, end_after=None):
        self.clock, self.counts, self.end_after = clock, Counter(weak=3), end_after
        self.sequence = 0

    async def run(self, publish, say):
        while self.sequence != self.end_after:
            self.sequence += 1
            bearings = [Bearing("L0", 0.001 * self.sequence, 0.01)]
            publish(BearingReport(self.clock.unix_ns(), self.sequence, "true_north", bearings))
            await self.clock.sleep(0.1)


@contextlib.asynccontextmanager
async def hosted(bus, clock, said, end_after=None):
    host = SensorHost(OneBearing(clock, end_after), "U1", KEYS, bus, clock)
    task = asyncio.create_task(host.run(said.append))
    await settle()
    try:
        yield task
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def test_the_ground_gets_its_reports_and_learns_its_clock():
    """The UAV's clock is an hour ahead, and all the ground knows of it is what comes over the bus."""
    bus, ground, uav, said = FakeBus(), ManualClock(), ManualClock(), []
    uav._started_ns += 3600 * 10**9
    clocks = ClockOffsets(["U1"], ground)
    feed = BearingFeed(["U1"], FormationFrame(0.0), ground, 0.5, clocks)
    clocks.attach(bus, KEYS)
    feed.attach(bus, KEYS)
    pinging = asyncio.create_task(clocks.run())
    async with hosted(bus, uav, said):
        for _ in range(30):
            await ground.advance(0.1)
            await uav.advance(0.1)
    pinging.cancel()
    assert KEYS.bearings("U1") in bus.urgent_keys
    assert feed.counters.received == 31
    assert feed.counters.from_the_future <= 12  # until the first answer
    assert feed.latest["U1"].captured_s == pytest.approx(ground.now_s(), abs=0.2)


async def test_it_answers_only_for_its_own_uav():
    bus, clock = FakeBus(), ManualClock()
    async with hosted(bus, clock, []):
        bus.put_latest(KEYS.clock_ping("U2"), encode(ClockPing(1)))
        bus.put_latest(KEYS.clock_ping("U1"), b"?")
        bus.put_latest(KEYS.clock_ping("U1"), encode(ClockPing(2)))
        assert bus.payloads(KEYS.clock_pong("U2")) == []
        (pong,) = bus.payloads(KEYS.clock_pong("U1"))
        assert decode(pong, ClockPong) == ClockPong(2, clock.unix_ns(), clock.unix_ns())


async def test_it_says_now_and_then_what_became_of_everything_and_that_the_bus_is_gone():
    bus, clock, said = FakeBus(), ManualClock(), []
    async with hosted(bus, clock, said):
        await clock.advance(TOLD_EVERY_S + 0.05)
        bus.up = False
        await clock.advance(TOLD_EVERY_S)
    assert said == [
        "U1: 101 reports published, 3 weak",
        "U1: 201 reports published, 3 weak (the bus cannot be reached)",
    ]


async def test_it_ends_when_its_sensor_does():
    bus, clock, said = FakeBus(), ManualClock(), []
    async with hosted(bus, clock, said, end_after=3) as task:
        await clock.advance(1.0)
        assert task.done()
    assert said == ["U1: 3 reports published, 3 weak"]


def test_every_kind_has_a_name_and_refuses_what_it_does_not_know():
    assert {"krakensdr", "replay"} <= SENSORS.keys()
    for kind in SENSORS:
        with pytest.raises(SensorError, match=kind):
            read_settings(kind, {"no_such_key": 1})
        with pytest.raises(SensorError, match=kind):
            read_settings(kind, ["not", "a", "mapping"])
