"""A stream that an autopilot needs even at rest: it holds, it never has a gap, and after one it never comes back."""

import asyncio
import cmath
import contextlib
import itertools
import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.autopilots.px4 import ACCELERATION_MPS2, LONGEST_GAP_S, Px4Copter
from drivers.mavlink.setpoints import OFFERED_S, SetpointStreamer, StreamLimits, StreamState
from tests.fakes import ManualClock, settle

OFFBOARD, LOITER, POSCTL = 0x0006_0000, 0x0304_0000, 0x0003_0000
ALTITUDE_M = 10.0
LIMITS = StreamLimits(rate_hz=10.0, lease_s=0.5, largest_speed_mps=5.0)


class Stream:
    """A streamer that runs, for a PX4 in OFFBOARD at its altitude, whose telemetry flows as the test lets time pass."""

    def __init__(self, rig, mode=OFFBOARD):
        self.rig, self.clock, self.wire = rig, rig.clock, rig.wire
        self.vehicle = rig.vehicle()
        self.mode, self.speed_mps, self.course, self.north = mode, 0.0, 1 + 0j, 0
        self.armed = True
        self.speak()
        self.streamer = SetpointStreamer(self.vehicle, Px4Copter(), ALTITUDE_M, LIMITS, self.clock)

    def speak(self):
        self.rig.copter.heartbeat(mode=self.mode, armed=self.armed, autopilot=mavlink.MAV_AUTOPILOT_PX4)
        velocity = self.speed_mps * self.course * 100
        north, east = round(velocity.real), round(velocity.imag)
        self.rig.copter.say(
            mavlink.MAVLink_global_position_int_message(
                0, 474_000_000 + self.north, 85_000_000, 439_000, 9_000, north, east, 0, 0
            )
        )

    async def live(self, duration_s, velocity=None):
        """Let time pass with telemetry, renewing a velocity where one is given."""
        for _ in range(round(duration_s / 0.1)):
            self.speak()
            if velocity is not None:
                self.streamer.renew(velocity)
            await self.clock.advance(0.1)

    @property
    def sent(self):
        return self.wire.setpoints

    @property
    def velocities(self):
        """(time, north + i east) of every velocity setpoint that left."""
        wanted = "SET_POSITION_TARGET_LOCAL_NED"
        return [
            (at.time_s, complex(at.message.vx, at.message.vy)) for at in self.sent if at.message.get_type() == wanted
        ]

    @contextlib.asynccontextmanager
    async def running(self):
        runner = asyncio.create_task(self.streamer.run())
        await settle()
        try:
            yield self
            assert not runner.done(), "the streamer ended"
        finally:
            runner.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await runner


@pytest.fixture
async def stream(rig):
    async with Stream(rig).running() as stream:
        yield stream


def largest_gap_s(stream):
    return max(later.time_s - earlier.time_s for earlier, later in itertools.pairwise(stream.sent))


async def test_a_vehicle_nobody_moves_is_streamed_its_place_at_its_altitude(stream):
    await stream.live(5.0)
    assert stream.streamer.state is StreamState.IDLING
    assert stream.velocities == []
    (setpoint,) = {
        (m.message.lat_int, m.message.lon_int, m.message.alt, m.message.type_mask, m.message.coordinate_frame)
        for m in stream.sent
    }
    assert setpoint == (474_000_000, 85_000_000, 440.0, 0x05F8, mavlink.MAV_FRAME_GLOBAL_INT)
    assert largest_gap_s(stream) < 0.16


async def test_the_place_that_is_held_does_not_drift_with_the_vehicle(stream):
    await stream.live(1.0)
    stream.north = 50
    await stream.live(2.0)
    assert stream.streamer.state is StreamState.IDLING
    assert {sent.message.lat_int for sent in stream.sent} == {474_000_000}


async def test_an_idle_setpoint_waits_no_longer_than_a_lease_and_in_nobodys_place(stream, monkeypatch):
    posted = []
    monkeypatch.setattr(
        stream.vehicle.link,
        "post_setpoint",
        lambda _, setpoint: posted.append((round(setpoint.expires_s - stream.clock.now_s(), 6), setpoint.stops)),
    )
    await stream.live(1.0)
    assert set(posted) == {(LIMITS.lease_s, False)}


async def test_before_during_and_after_a_leg_the_stream_has_no_gap(stream):
    await stream.live(2.0)
    await stream.live(3.0, 3 + 0j)
    stream.streamer.stop()
    await stream.live(5.0)
    assert largest_gap_s(stream) < 0.16
    assert stream.streamer.state is StreamState.IDLING


async def test_a_velocity_is_approached_no_faster_than_the_vehicle_may_accelerate(stream):
    await stream.live(4.0, 5 + 0j)
    await stream.live(4.0, -3j)
    flown = [(stream.velocities[0][0] - 0.1, 0j), *stream.velocities]
    for (earlier_s, earlier), (later_s, later) in itertools.pairwise(flown):
        assert abs(later - earlier) <= ACCELERATION_MPS2 * (later_s - earlier_s) + 1e-6
    assert max(abs(velocity) for _, velocity in flown) <= LIMITS.largest_speed_mps
    assert flown[-1][1] == pytest.approx(-3j)


async def test_a_stream_that_was_held_up_does_not_catch_up_in_one_leap(stream):
    await stream.live(1.0, 1 + 0j)
    stream.clock.jump(0.6)  # the event loop was busy
    stream.speak()
    stream.streamer.renew(5 + 0j)
    await settle()
    (_, before), (_, after) = stream.velocities[-2:]
    assert abs(after - before) == pytest.approx(ACCELERATION_MPS2 / LIMITS.rate_hz)


@pytest.mark.parametrize("way", ["stop", "renewal with zero"])
async def test_a_stop_is_never_slowed_down(stream, way):
    await stream.live(4.0, 5 + 0j)
    if way == "stop":
        stream.streamer.stop()
    else:
        stream.streamer.renew(0j)
    await settle()
    assert stream.velocities[-1] == (stream.clock.now_s(), 0j)


@pytest.mark.parametrize("course", [1 + 0j, 1j, -1 + 0j, -1j])
async def test_zero_velocity_is_repeated_until_the_vehicle_is_slow_and_then_its_place_is_held(stream, course):
    stream.speed_mps, stream.course = 4.0, course
    await stream.live(2.0, 4 * course)
    stream.streamer.stop()
    await stream.live(1.0)
    assert stream.streamer.state is StreamState.STOPPING
    stream.speed_mps = 0.6
    await stream.live(0.3)
    assert stream.streamer.state is StreamState.STOPPING
    stream.speed_mps = 0.3
    await stream.live(0.2)
    assert stream.streamer.state is StreamState.IDLING


async def test_a_place_told_too_long_ago_is_not_gone_back_to(stream):
    stream.speed_mps = 4.0
    await stream.live(1.0, 4 + 0j)
    for _ in range(40):
        stream.rig.copter.heartbeat(mode=OFFBOARD, autopilot=mavlink.MAV_AUTOPILOT_PX4)  # but no position
        await stream.clock.advance(0.1)
    assert stream.streamer.state is StreamState.IDLING
    assert stream.velocities[-1][1] == 0j
    assert stream.sent[-1].message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"


@pytest.mark.parametrize("mode", [LOITER, POSCTL, 0x0504_0000, 0x0604_0000])
@pytest.mark.parametrize("moving", [True, False])
async def test_any_other_mode_is_somebody_elses_and_ends_the_stream_for_good(stream, mode, moving):
    await stream.live(2.0, 3 + 0j if moving else None)
    stream.mode = mode
    stream.speak()
    left = len(stream.sent)
    await stream.live(3.0, 3 + 0j)
    stream.mode = OFFBOARD
    await stream.live(3.0, 3 + 0j)
    stream.streamer.stop()
    await stream.live(1.0)
    assert len(stream.sent) == left
    assert stream.streamer.state is StreamState.PILOT


@pytest.mark.parametrize("moving", [True, False])
async def test_a_stream_that_had_a_gap_does_not_come_back_whatever_the_last_heartbeat_said(stream, moving):
    await stream.live(2.0, 3 + 0j if moving else None)
    left = len(stream.sent)
    stream.clock.jump(LONGEST_GAP_S + 0.1)  # the event loop was busy
    stream.streamer.renew(3 + 0j)
    stream.streamer.stop()
    stream.streamer.release()
    await stream.live(3.0, 3 + 0j)
    assert len(stream.sent) == left
    assert stream.streamer.state is StreamState.PILOT


@pytest.mark.parametrize("moving", [True, False])
async def test_a_stream_that_had_a_gap_does_not_come_back_though_the_vehicle_is_heard_first(stream, moving):
    await stream.live(2.0, 3 + 0j if moving else None)
    left = len(stream.sent)
    stream.clock.jump(LONGEST_GAP_S + 0.1)  # the event loop was busy, and reads what came meanwhile
    await stream.live(3.0, 3 + 0j)
    assert len(stream.sent) == left
    assert stream.streamer.state is StreamState.PILOT


async def test_a_vehicle_unheard_for_as_long_may_not_have_heard_the_stream_either(stream):
    await stream.clock.advance(LONGEST_GAP_S + 0.2)
    assert stream.streamer.state is StreamState.PILOT
    left = len(stream.sent)
    await stream.live(3.0, 3 + 0j)
    assert len(stream.sent) == left


async def test_after_a_gap_the_operators_release_needs_a_heartbeat_in_offboard_since(stream):
    stream.clock.jump(LONGEST_GAP_S + 0.1)
    await stream.clock.advance(0.1)
    stream.streamer.release()
    assert stream.streamer.state is StreamState.PILOT
    stream.speak()
    stream.streamer.release()
    await stream.live(1.0)
    assert stream.streamer.state is StreamState.IDLING
    assert stream.velocities == []


async def taken(stream, mode=LOITER):
    await stream.live(1.0)
    stream.mode = mode
    await stream.live(1.0)
    assert stream.streamer.state is StreamState.PILOT
    return len(stream.sent)


@pytest.mark.parametrize("lost", ["by a mode", "by a gap"])
async def test_released_in_another_mode_its_place_is_streamed_until_the_operator_has_asked_for_offboard(stream, lost):
    """OFFBOARD is not entered without a stream: without this nobody could give the vehicle back."""
    if lost == "by a gap":
        stream.clock.jump(LONGEST_GAP_S + 0.1)
    left = await taken(stream)
    assert "OFFBOARD" in stream.streamer.release()
    await stream.live(3.0)
    assert stream.streamer.state is StreamState.PILOT
    stream.north = 5_000  # its pilot still flies it
    await stream.live(1.0)
    stream.mode = OFFBOARD
    await stream.live(2.0)
    assert stream.streamer.state is StreamState.IDLING
    assert stream.velocities == []
    assert max(later.time_s - earlier.time_s for earlier, later in itertools.pairwise(stream.sent[left:])) < 0.16
    assert {sent.message.lat_int for sent in stream.sent[left:]} == {474_000_000, 474_005_000}
    assert stream.sent[-1].message.lat_int == 474_005_000
    await stream.live(1.0, 3 + 0j)
    assert stream.streamer.state is StreamState.LEASED


async def test_made_for_one_that_holds_by_itself_nothing_is_streamed_before_the_operators_release(rig):
    """It would enter OFFBOARD by itself: it is there that its stream was lost, by a service or a node that has died."""
    async with Stream(rig, LOITER).running() as stream:
        await stream.live(2.0, 3 + 0j)
        stream.mode = OFFBOARD
        await stream.live(2.0, 3 + 0j)
        assert stream.sent == []
        assert stream.streamer.state is StreamState.PILOT


async def test_an_offer_ends_and_then_offboard_alone_gives_nothing_back(stream):
    left = await taken(stream)
    stream.streamer.release()
    await stream.live(OFFERED_S + 1.0)
    offered = len(stream.sent)
    assert offered > left
    stream.mode = OFFBOARD
    await stream.live(3.0, 3 + 0j)
    assert len(stream.sent) == offered
    assert stream.streamer.state is StreamState.PILOT
    assert stream.streamer.release() is None


async def test_a_pilot_who_takes_it_again_ends_the_offer_with_it(stream):
    await taken(stream)
    stream.streamer.release()
    stream.mode = OFFBOARD
    await stream.live(1.0)
    left = await taken(stream, POSCTL)
    stream.mode = OFFBOARD
    await stream.live(2.0, 3 + 0j)
    assert len(stream.sent) == left


async def test_an_offer_is_not_taken_up_on_the_ground(stream):
    await taken(stream)
    stream.streamer.release()
    stream.armed, stream.mode = False, OFFBOARD
    await stream.live(1.0)
    assert stream.streamer.state is StreamState.PILOT


@pytest.mark.parametrize("mode", [OFFBOARD, LOITER])
async def test_a_vehicle_on_the_ground_is_not_released(stream, mode):
    await taken(stream)
    stream.armed, stream.mode = False, mode
    await stream.live(1.0)
    left = len(stream.sent)
    assert "disarmed" in stream.streamer.release()
    await stream.live(2.0)
    assert len(stream.sent) == left


async def test_no_message_of_the_stream_changes_a_mode(stream):
    await stream.live(1.0, 3 + 0j)
    stream.streamer.stop()
    await stream.live(3.0)
    assert {message.get_type() for message in stream.wire.messages} == {
        "SET_POSITION_TARGET_LOCAL_NED",
        "SET_POSITION_TARGET_GLOBAL_INT",
    }


velocities = st.builds(cmath.rect, st.floats(0.5, 5.0), st.floats(-math.pi, math.pi))
events = st.one_of(
    st.tuples(st.just("renew"), velocities),
    st.tuples(st.just("mode"), st.sampled_from([OFFBOARD, OFFBOARD, LOITER])),
    st.tuples(st.sampled_from(["live", "live", "jump", "silence"]), st.floats(0.0, 1.5)),
    st.tuples(st.sampled_from(["stop", "release"]), st.none()),
)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(events, min_size=3, max_size=20))
def test_whatever_happens_no_motion_outlives_its_lease_and_nothing_follows_a_take_over(make_rig, happenings):
    async def scenario():
        async with make_rig(ManualClock()).running() as rig, Stream(rig).running() as stream:
            renewed_s, checked, offered = -math.inf, 0, False
            for kind, value in happenings:
                taken, before = stream.streamer.state is StreamState.PILOT, len(stream.sent)
                offered = taken and (offered or kind == "release")
                if kind == "renew":
                    stream.streamer.renew(value)
                    renewed_s = stream.clock.now_s()
                elif kind == "mode":
                    stream.mode = value
                    stream.speak()
                elif kind == "live":
                    await stream.live(value)
                elif kind == "jump":
                    stream.clock.jump(value)
                elif kind == "silence":
                    await stream.clock.advance(value)
                else:
                    getattr(stream.streamer, kind)()
                await settle()
                if taken and not offered:
                    assert len(stream.sent) == before, "a setpoint left against the pilot"
                for time_s, velocity in stream.velocities[checked:]:
                    assert not velocity or time_s <= renewed_s + LIMITS.lease_s, "motion without a lease"
                checked = len(stream.velocities)

    asyncio.run(scenario())
