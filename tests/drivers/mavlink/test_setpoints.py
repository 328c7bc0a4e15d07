"""The lease: motion leaves only while somebody keeps renewing it, and never against the pilot.

Every assertion counts on the wire: what left, and when.
"""

import asyncio
import cmath
import contextlib
import itertools
import math
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import SetpointError
from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits, StreamState
from tests.fakes import ManualClock, settle

GUIDED, LOITER, RTL = 4, 5, 6
ALTITUDE_M = 10.0
LIMITS = StreamLimits(rate_hz=10.0, lease_s=0.5, largest_speed_mps=5.0)
TICK_S = 0.05
ZERO_S = 2.0


class Stream:
    """A streamer that runs, for a vehicle that hovers in GUIDED at its altitude."""

    def __init__(self, rig, limits=LIMITS):
        self.rig, self.clock, self.wire, self.copter = rig, rig.clock, rig.wire, rig.copter
        self.vehicle = rig.vehicle()
        self.copter.heartbeat(mode=GUIDED)
        self.copter.at_height(ALTITUDE_M)
        self.streamer = SetpointStreamer(self.vehicle, ArduCopter(), ALTITUDE_M, limits, self.clock)

    @property
    def sent(self):
        """(time, north + i east, down) of every setpoint that left."""
        return [(at.time_s, complex(at.message.vx, at.message.vy), at.message.vz) for at in self.wire.setpoints]

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

    async def renew_for(self, duration_s, velocity, every_s=0.1):
        for _ in range(round(duration_s / every_s)):
            self.streamer.renew(velocity)
            await self.clock.advance(every_s)


@pytest.fixture
async def stream(rig):
    async with Stream(rig).running() as stream:
        yield stream


async def test_nothing_leaves_before_the_first_renewal(stream):
    await stream.clock.advance(10.0)
    assert stream.sent == []
    assert stream.rig.link.counters.dropped == 0
    assert stream.streamer.state is StreamState.SILENT


async def test_a_renewal_leaves_at_once_and_is_repeated_at_the_rate_while_the_lease_lasts(stream):
    stream.streamer.renew(3 - 2j)
    await settle()
    assert stream.sent == [(stream.clock.now_s(), 3 - 2j, 0.0)]
    await stream.clock.advance(0.4)
    times = [time_s for time_s, _, _ in stream.sent]
    assert {velocity for _, velocity, _ in stream.sent} == {3 - 2j}
    assert all(0.09 < later - earlier < 0.16 for earlier, later in itertools.pairwise(times))


async def test_without_renewal_zero_velocity_at_the_leases_end_then_repeated_then_silence(stream):
    stream.streamer.renew(4 + 0j)
    renewed_s = stream.clock.now_s()
    await stream.clock.advance(60.0)
    moving = [time_s for time_s, velocity, _ in stream.sent if velocity != 0]
    still = [time_s for time_s, velocity, _ in stream.sent if velocity == 0]
    assert max(moving) < renewed_s + LIMITS.lease_s
    assert renewed_s + LIMITS.lease_s <= still[0] <= renewed_s + LIMITS.lease_s + TICK_S + 1e-9
    assert len(still) >= 10
    assert still[0] + ZERO_S - 0.2 <= still[-1] <= still[0] + ZERO_S
    assert max(later - earlier for earlier, later in itertools.pairwise(still)) < 0.16
    assert stream.streamer.state is StreamState.SILENT


async def test_a_kept_up_lease_flies_on_and_the_latest_velocity_holds(stream):
    await stream.renew_for(3.0, 2 + 0j)
    await stream.renew_for(3.0, 0 + 2j)
    assert 0j not in {velocity for _, velocity, _ in stream.sent}
    assert stream.sent[-1][1] == 2j
    assert stream.streamer.state is StreamState.LEASED


async def test_a_busy_event_loop_does_not_prolong_the_lease(stream):
    stream.streamer.renew(4 + 0j)
    await settle()
    stream.clock.jump(5.0)
    await stream.clock.advance(0.0)
    assert [velocity for _, velocity, _ in stream.sent] == [4, 0]


async def test_a_motion_that_had_to_wait_for_longer_than_its_lease_does_not_leave(stream):
    stream.streamer.renew(4 + 0j)
    stream.clock.jump(LIMITS.lease_s + 0.01)  # before the link's owner has run
    await stream.clock.advance(1.0)
    assert {velocity for _, velocity, _ in stream.sent} == {0j}


async def test_every_repeated_motion_expires_with_its_lease_and_every_stop_with_its_repetition(stream, monkeypatch):
    posted = []
    monkeypatch.setattr(stream.vehicle.link, "post_setpoint", lambda _, setpoint: posted.append(setpoint))
    renewed_s = stream.clock.now_s()
    stream.streamer.renew(4 + 0j)
    await stream.clock.advance(5.0)
    moving = [setpoint.expires_s for setpoint in posted if setpoint.message.vx]
    still = [setpoint.expires_s for setpoint in posted if not setpoint.message.vx]
    assert moving == pytest.approx([renewed_s + LIMITS.lease_s] * 5)
    assert len(still) >= 10
    assert still == pytest.approx([renewed_s + LIMITS.lease_s + ZERO_S] * len(still), abs=0.01)
    assert [setpoint.stops for setpoint in posted] == [False] * len(moving) + [True] * len(still)


async def test_a_lease_of_no_whole_number_of_periods_ends_on_time_too(rig):
    async with Stream(rig, replace(LIMITS, lease_s=0.23)).running() as stream:
        renewed_s = stream.clock.now_s()
        stream.streamer.renew(4 + 0j)
        await stream.clock.advance(1.0)
        first_still_s = min(time_s for time_s, velocity, _ in stream.sent if velocity == 0)
    assert first_still_s == pytest.approx(renewed_s + 0.23, abs=0.01)


async def test_zero_velocity_may_be_renewed_like_any_other(stream):
    await stream.renew_for(1.0, 0j)
    assert {velocity for _, velocity, _ in stream.sent} == {0j}
    assert stream.streamer.state is StreamState.LEASED


async def test_a_stop_leaves_ahead_of_everything_and_takes_the_waiting_motion_with_it(stream):
    for _ in range(5):
        stream.vehicle.tell(mavlink.MAV_CMD_REQUEST_MESSAGE, 1)
    stream.streamer.renew(5 + 0j)
    stream.streamer.stop()
    await settle()
    first, *others = stream.wire.messages
    assert first.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    assert (first.vx, first.vy) == (0.0, 0.0)
    assert {message.get_type() for message in others} == {"COMMAND_LONG"}


async def test_a_stop_leaves_ahead_of_the_motion_of_others_on_the_link(stream):
    other = stream.rig.vehicle("U2", 2)
    stream.rig.speaker(2).heartbeat(mode=GUIDED)
    SetpointStreamer(other, ArduCopter(), ALTITUDE_M, LIMITS, stream.clock).renew(2 + 0j)
    stream.streamer.stop()
    await settle()
    assert [sent.message.target_system for sent in stream.wire.setpoints] == [1, 2]


async def test_a_stop_waiting_to_be_sent_is_not_sent_once_the_pilot_has_the_vehicle(stream):
    stream.streamer.stop()
    stream.rig.speaker(1).heartbeat(mode=5)  # LOITER, before the link's owner has run
    await settle()
    assert stream.sent == []


async def test_nothing_is_flown_before_a_heartbeat_tells_the_mode(rig, clock):
    streamer = SetpointStreamer(rig.vehicle("U9", 9), ArduCopter(), ALTITUDE_M, LIMITS, clock)
    streamer.renew(1 + 0j)
    streamer.stop()
    await settle()
    assert streamer.state is StreamState.PILOT
    assert rig.wire.setpoints == []


async def test_a_stop_is_repeated_while_the_vehicle_stops_then_silent(stream):
    await stream.renew_for(1.0, 5 + 0j)
    stopped_s = stream.clock.now_s()
    stream.streamer.stop()
    await stream.clock.advance(60.0)
    after = [(time_s, velocity) for time_s, velocity, _ in stream.sent if time_s >= stopped_s]
    assert {velocity for _, velocity in after[1:]} == {0j}
    assert after[0] == (stopped_s, 0j) or after[1] == (stopped_s, 0j)
    assert stopped_s + ZERO_S - 0.2 <= after[-1][0] <= stopped_s + ZERO_S


async def test_a_stop_is_repeated_for_as_long_to_a_copter_that_says_that_it_stands(stream):
    stream.copter.say(mavlink.MAVLink_global_position_int_message(0, 474_000_000, 85_000_000, 0, 10_000, 0, 0, 0, 0))
    stopped_s = stream.clock.now_s()
    stream.streamer.stop()
    await stream.clock.advance(5.0)
    assert stream.sent[-1][0] >= stopped_s + ZERO_S - 0.2


async def test_a_renewal_after_a_stop_flies_again(stream):
    stream.streamer.stop()
    await settle()
    stream.streamer.renew(1 + 0j)
    await settle()
    assert [velocity for _, velocity, _ in stream.sent] == [0, 1]


@pytest.mark.parametrize(
    "velocity",
    [
        complex(math.nan, 0),
        complex(0, math.nan),
        complex(math.inf, 0),
        complex(0, -math.inf),
        5.1 + 0j,
        5.01 + 0j,
        4 + 4j,
        -1e300j,
    ],
)
async def test_a_velocity_that_is_not_finite_or_too_fast_is_refused_and_renews_nothing(stream, velocity):
    stream.streamer.renew(2 + 0j)
    renewed_s = stream.clock.now_s()
    await stream.clock.advance(0.3)
    with pytest.raises(SetpointError, match="U1: "):
        stream.streamer.renew(velocity)
    await stream.clock.advance(5.0)
    assert {sent for _, sent, _ in stream.sent} == {2, 0}
    assert all(time_s < renewed_s + LIMITS.lease_s for time_s, sent, _ in stream.sent if sent)


async def test_the_limit_itself_may_be_flown_whatever_the_rounding(stream):
    for azimuth_deg in range(0, 360, 7):
        stream.streamer.renew(cmath.rect(5.0, math.radians(azimuth_deg)))
        await settle()
    assert len(stream.sent) == 52


async def test_a_setpoint_is_velocity_and_yaw_rate_in_the_local_frame_and_nothing_else(stream):
    stream.streamer.renew(1.5 - 2.5j)
    stream.streamer.stop()
    stream.streamer.renew(1.5 - 2.5j)
    await stream.clock.advance(3.0)
    assert len(stream.wire.setpoints) > 10
    for sent in stream.wire.setpoints:
        message = sent.message
        assert message.type_mask == 0x05C7
        assert message.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
        assert (message.target_system, message.target_component) == (1, 1)
        assert (message.yaw, message.yaw_rate) == (0.0, 0.0)
        assert (message.x, message.y, message.z) == (message.afx, message.afy, message.afz) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("mode", [LOITER, RTL, 9, 17, 2, 0, 27, 4_000_000_000])
async def test_a_heartbeat_in_any_other_mode_silences_the_stream_for_good(stream, mode):
    stream.streamer.renew(4 + 0j)
    await stream.clock.advance(0.1)
    stream.copter.heartbeat(mode=mode)
    left = len(stream.sent)
    for _ in range(20):
        stream.streamer.renew(4 + 0j)
        stream.streamer.stop()
        await stream.clock.advance(0.25)
    assert len(stream.sent) == left
    assert stream.streamer.state is StreamState.PILOT


async def test_a_motion_still_waiting_does_not_leave_after_the_pilots_heartbeat(stream):
    stream.streamer.renew(4 + 0j)
    stream.copter.heartbeat(mode=LOITER)
    await stream.clock.advance(5.0)
    assert stream.sent == []


async def test_the_pilot_ends_the_zero_velocity_after_a_lease_too(stream):
    stream.streamer.renew(4 + 0j)
    await stream.clock.advance(LIMITS.lease_s + 0.3)
    assert stream.streamer.state is StreamState.STOPPING
    stream.copter.heartbeat(mode=LOITER)
    left = len(stream.sent)
    await stream.clock.advance(5.0)
    assert len(stream.sent) == left


async def test_a_return_to_guided_alone_does_not_end_the_pilots_word(stream):
    stream.copter.heartbeat(mode=LOITER)
    stream.copter.heartbeat(mode=GUIDED)
    await stream.renew_for(3.0, 4 + 0j)
    stream.streamer.stop()
    await stream.clock.advance(3.0)
    assert stream.sent == []


async def test_a_streamer_made_while_the_pilot_flies_is_silent_too(rig):
    vehicle = rig.vehicle()
    rig.copter.heartbeat(mode=LOITER)
    streamer = SetpointStreamer(vehicle, ArduCopter(), ALTITUDE_M, LIMITS, rig.clock)
    streamer.renew(1 + 0j)
    streamer.stop()
    await settle()
    assert streamer.state is StreamState.PILOT
    assert rig.wire.setpoints == []


async def test_a_release_outside_guided_changes_nothing(stream):
    stream.copter.heartbeat(mode=LOITER)
    assert "GUIDED" in stream.streamer.release()
    await stream.renew_for(2.0, 4 + 0j)
    assert stream.sent == []
    assert stream.streamer.state is StreamState.PILOT


async def test_one_released_outside_guided_has_to_be_released_again_in_it(stream):
    stream.copter.heartbeat(mode=LOITER)
    stream.streamer.release()
    stream.copter.heartbeat(mode=GUIDED)
    await stream.renew_for(2.0, 4 + 0j)
    assert stream.sent == []
    assert stream.streamer.state is StreamState.PILOT
    assert stream.streamer.release() is None


async def test_a_release_in_guided_moves_nothing_until_the_next_renewal(stream):
    stream.streamer.renew(4 + 0j)
    await settle()
    stream.copter.heartbeat(mode=LOITER)
    stream.copter.heartbeat(mode=GUIDED)
    assert stream.streamer.release() is None
    await stream.clock.advance(5.0)
    assert [velocity for _, velocity, _ in stream.sent] == [4]
    stream.streamer.renew(1 + 0j)
    await settle()
    assert [velocity for _, velocity, _ in stream.sent] == [4, 1]


async def test_a_release_that_is_not_needed_does_not_stop_the_flight(stream):
    stream.streamer.renew(4 + 0j)
    stream.streamer.release()
    assert stream.streamer.state is StreamState.LEASED


async def test_other_senders_heartbeats_are_no_pilot(stream):
    stream.rig.speaker(1, 191).heartbeat(mode=LOITER)
    stream.rig.speaker(2).heartbeat(mode=LOITER)
    stream.rig.speaker(255, 190).heartbeat(mode=0, autopilot=8, vehicle_type=6)
    stream.streamer.renew(4 + 0j)
    await settle()
    assert [velocity for _, velocity, _ in stream.sent] == [4]


@pytest.mark.parametrize(
    ("height_m", "down_mps"),
    [(10.0, 0.0), (9.0, -0.5), (10.4, 0.2), (2.0, -1.0), (500.0, 1.0), (-3.0, -1.0)],
)
async def test_the_altitude_is_held_by_a_slow_and_clamped_vertical_speed(stream, height_m, down_mps):
    stream.copter.at_height(height_m)
    stream.streamer.renew(3 + 0j)
    await settle()
    stream.streamer.stop()
    await settle()
    assert [down for _, _, down in stream.sent] == pytest.approx([down_mps, down_mps])


async def test_a_stale_altitude_is_not_steered_by(stream):
    stream.copter.at_height(2.0)
    await stream.clock.advance(0.9)
    stream.streamer.renew(3 + 0j)
    await stream.clock.advance(0.2)
    stream.streamer.renew(3 + 0j)
    await settle()
    downs = [down for _, _, down in stream.sent]
    assert (downs[0], downs[-1]) == (-1.0, 0.0)


async def test_an_altitude_never_heard_is_level(rig):
    vehicle = rig.vehicle()
    rig.copter.heartbeat(mode=GUIDED)
    SetpointStreamer(vehicle, ArduCopter(), ALTITUDE_M, LIMITS, rig.clock).renew(3 + 0j)
    await settle()
    assert [sent.message.vz for sent in rig.wire.setpoints] == [0.0]


async def test_no_message_of_the_stream_changes_a_mode(stream):
    await stream.renew_for(2.0, 4 + 0j)
    stream.streamer.stop()
    await stream.clock.advance(3.0)
    stream.copter.heartbeat(mode=LOITER)
    await stream.renew_for(1.0, 4 + 0j)
    stream.copter.heartbeat(mode=GUIDED)
    stream.streamer.release()
    await stream.renew_for(1.0, 4 + 0j)
    assert {message.get_type() for message in stream.wire.messages} == {"SET_POSITION_TARGET_LOCAL_NED"}


async def test_two_vehicles_behind_one_link_have_leases_of_their_own(stream):
    other = stream.rig.vehicle("U2", 2)
    stream.rig.speaker(2).heartbeat(mode=GUIDED)
    second = SetpointStreamer(other, ArduCopter(), ALTITUDE_M, LIMITS, stream.clock)
    stream.streamer.renew(1 + 0j)
    second.renew(2 + 0j)
    stream.copter.heartbeat(mode=LOITER)
    await settle()
    assert [(sent.message.target_system, sent.message.vx) for sent in stream.wire.setpoints] == [(2, 2.0)]


velocities = st.builds(cmath.rect, st.floats(0.5, 5.0), st.floats(-math.pi, math.pi))
events = st.one_of(
    st.tuples(st.just("renew"), velocities),
    st.tuples(st.just("renew"), st.sampled_from([complex("nan"), complex("inf"), 9 + 0j])),
    st.tuples(st.just("heartbeat"), st.sampled_from([GUIDED, GUIDED, LOITER, RTL])),
    st.tuples(st.just("height"), st.floats(-5.0, 200.0)),
    st.tuples(st.sampled_from(["advance", "advance", "jump"]), st.floats(0.0, 0.7) | st.floats(0.0, 4.0)),
    st.tuples(st.sampled_from(["stop", "release"]), st.none()),
)


class LeaseModel:
    """What may be on the wire, told from the events alone."""

    def __init__(self, stream):
        self.stream = stream
        self.checked = 0
        self.renewed = None
        self.pilot = False
        self.mode = GUIDED

    def happen(self, kind, value):
        streamer = self.stream.streamer
        if kind == "renew":
            try:
                streamer.renew(value)
            except SetpointError:
                return
            if not self.pilot:
                self.renewed = (self.stream.clock.now_s(), value)
        elif kind == "heartbeat":
            self.stream.copter.heartbeat(mode=value)
            self.mode = value
            self.pilot = self.pilot or value != GUIDED
        elif kind == "height":
            self.stream.copter.at_height(value)
        elif kind == "stop":
            streamer.stop()
            self.renewed = None if not self.pilot else self.renewed
        elif kind == "release":
            streamer.release()
            if self.pilot and self.mode == GUIDED:
                self.pilot, self.renewed = False, None

    def check(self):
        for time_s, velocity, down_mps in self.stream.sent[self.checked :]:
            assert not self.pilot, "a setpoint left against the pilot"
            assert abs(down_mps) <= 1.0
            if velocity:
                assert self.renewed is not None, "motion without a lease"
                renewed_s, wanted = self.renewed
                assert time_s <= renewed_s + LIMITS.lease_s
                assert abs(velocity - wanted) < 1e-5
        self.checked = len(self.stream.sent)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(events, min_size=3, max_size=25))
def test_whatever_happens_motion_never_outlives_its_lease_nor_the_pilots_word(make_rig, happenings):
    async def scenario():
        async with make_rig(ManualClock()).running() as rig, Stream(rig).running() as stream:
            model = LeaseModel(stream)
            for kind, value in happenings:
                model.happen(kind, value)
                await settle()
                if kind == "advance":
                    await stream.clock.advance(value)
                elif kind == "jump":
                    stream.clock.jump(value)
                    await stream.clock.advance(0.0)
                model.check()
            await stream.clock.advance(LIMITS.lease_s + ZERO_S + 0.1)
            model.check()
            left = len(stream.sent)
            await stream.clock.advance(2.0)
            assert len(stream.sent) == left, "no silence after the lease"
            assert {message.get_type() for message in stream.wire.messages} <= {"SET_POSITION_TARGET_LOCAL_NED"}

    asyncio.run(scenario())
