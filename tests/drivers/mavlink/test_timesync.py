"""The offset of an autopilot's clock comes from its quickest answer."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.timesync import measure_clock
from tests.fakes import FAKE_UNIX_NS

BOOTED_NS = FAKE_UNIX_NS - 40_000_000_000
"""When the autopilot was switched on, by this service's clock."""


class Autopilot:
    """Answers each question after a way there and a way back of its own, s; None: not at all."""

    def __init__(self, rig, *ways_s):
        self.rig = rig
        self.ways_s = list(ways_s)
        self.asked = 0
        self._tasks = []
        rig.wire.on_send = self._hear

    def _hear(self, message):
        if message.get_type() == "TIMESYNC":
            assert message.tc1 == 0
            self.asked += 1
            self._tasks.append(asyncio.create_task(self._answer(message.ts1, self.ways_s.pop(0))))

    async def _answer(self, ts1, ways_s):
        if ways_s is None:
            return
        there_s, back_s = ways_s
        await self.rig.clock.sleep(there_s)
        own_ns = self.rig.clock.unix_ns() - BOOTED_NS
        await self.rig.clock.sleep(back_s)
        self.rig.copter.say(mavlink.MAVLink_timesync_message(own_ns, ts1))


async def measure(rig, *ways_s):
    autopilot = Autopilot(rig, *ways_s)
    call = asyncio.create_task(measure_clock(rig.vehicle(), questions=len(ways_s)))
    await rig.clock.advance(len(ways_s) + 1.0)
    assert autopilot.asked == len(ways_s)
    return call.result()


async def test_even_ways_give_the_offset_exactly(rig):
    offset = await measure(rig, (0.05, 0.05))
    assert offset.offset_ns == pytest.approx(BOOTED_NS, abs=1000)
    assert offset.round_trip_s == pytest.approx(0.1)


async def test_the_quickest_of_several_counts(rig):
    offset = await measure(rig, (0.6, 0.05), (0.01, 0.01), (0.02, 0.7))
    assert offset.offset_ns == pytest.approx(BOOTED_NS, abs=1000)
    assert offset.uncertainty_s == pytest.approx(0.01)


@pytest.mark.parametrize("ways_s", [(0.2, 0.0), (0.0, 0.2), (0.05, 0.15)])
async def test_the_error_of_uneven_ways_stays_within_the_uncertainty(rig, ways_s):
    offset = await measure(rig, ways_s)
    assert abs(offset.offset_ns - BOOTED_NS) * 1e-9 <= offset.uncertainty_s + 1e-6


async def test_without_an_answer_there_is_no_offset(rig):
    assert await measure(rig, None, None) is None


async def test_lost_answers_leave_the_others(rig):
    assert (await measure(rig, None, (0.1, 0.1), None)).round_trip_s == pytest.approx(0.2)


async def test_the_autopilots_own_questions_and_answers_to_others_are_no_answers(rig):
    call = asyncio.create_task(measure_clock(rig.vehicle(), questions=1))
    await rig.clock.advance(0.1)
    rig.copter.say(mavlink.MAVLink_timesync_message(0, 5_216_000_000))
    rig.copter.say(mavlink.MAVLink_timesync_message(5_216_000_000, 12345))
    await rig.clock.advance(2.0)
    assert call.result() is None
