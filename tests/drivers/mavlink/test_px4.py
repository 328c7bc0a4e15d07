"""PX4, against a copter that acknowledges one thing and does another: the stream, the mode, the arming, the climb."""

import itertools

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import VehicleError
from drivers.mavlink.autopilots import autopilot_of
from drivers.mavlink.autopilots.px4 import CLIMB_MPS, READY_TIMEOUT_S, STREAM_BEFORE_S, Px4Copter
from drivers.mavlink.vehicle import Heartbeat
from tests.drivers.mavlink.scripted import Flight
from tests.fakes import settle

SET_MODE, ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
OFFBOARD, LOITER, RTL, LAND, POSCTL = 0x0006_0000, 0x0304_0000, 0x0504_0000, 0x0604_0000, 0x0003_0000
STANDBY, UNINIT = mavlink.MAV_STATE_STANDBY, mavlink.MAV_STATE_UNINIT
PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
ALTITUDE_M = 10.0
HOME_AMSL_M = 430.0


@pytest.fixture
async def flight(rig):
    flight = Flight(rig, Px4Copter(), ALTITUDE_M)
    heartbeat(flight, LOITER, armed=False)
    flight.says.at_height(0.0)
    yield flight
    await flight.close()


def heartbeat(flight, mode, *, armed=True, status=STANDBY):
    flight.says.heartbeat(mode=mode, armed=armed, autopilot=mavlink.MAV_AUTOPILOT_PX4, status=status)


async def climbing(flight):
    """Start a take-off and bring it to where it is armed and rises."""
    call = await flight.take_off()
    await flight.clock.advance(STREAM_BEFORE_S)
    heartbeat(flight, OFFBOARD, armed=False)
    await settle()
    heartbeat(flight, OFFBOARD, armed=True)
    await settle()
    return call


def modes_asked(flight):
    return [(m.param1, m.param2, m.param3) for m in flight.wire.commands if m.command == SET_MODE]


def test_only_offboard_is_guided():
    modes = [OFFBOARD, LOITER, RTL, LAND, POSCTL, 0, 4, 6, OFFBOARD + 1]
    heartbeats = [Heartbeat(0.0, 2, 12, mode, armed=True, system_status=4) for mode in modes]
    assert [heartbeat.custom_mode for heartbeat in heartbeats if Px4Copter().is_guided(heartbeat)] == [OFFBOARD]


async def test_the_strategy_follows_from_the_heartbeat(flight):
    assert isinstance(autopilot_of(flight.vehicle), Px4Copter)


async def test_preparing_asks_for_position_and_health(flight):
    await flight.start(flight.autopilot.prepare(flight.vehicle))
    assert flight.commands == [SET_INTERVAL] * 3
    assert {int(message.param1): message.param2 for message in flight.wire.commands} == {
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 200_000.0,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1_000_000.0,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1_000_000.0,
    }


@pytest.mark.parametrize("sign", ["standby", "prearm bit"])
async def test_it_is_ready_when_px4_says_standby_or_the_prearm_check_is_healthy(rig, sign):
    flight = Flight(rig, Px4Copter(), ALTITUDE_M)
    heartbeat(flight, LOITER, armed=False, status=UNINIT)
    flight.says.at_height(0.0)
    flight.says.health(0xFFFF)
    call = await flight.start(flight.autopilot.prepare(flight.vehicle))
    assert not call.done()
    if sign == "standby":
        heartbeat(flight, LOITER, armed=False, status=STANDBY)
    else:
        flight.says.health(0xFFFF | PREARM)
    await settle()
    assert call.done()
    assert call.exception() is None


async def test_a_vehicle_that_never_gets_ready_is_an_error_with_its_own_words(rig):
    flight = Flight(rig, Px4Copter(), ALTITUDE_M)
    heartbeat(flight, LOITER, armed=False, status=UNINIT)
    call = await flight.start(flight.autopilot.prepare(flight.vehicle))
    flight.says.text("Preflight Fail: No connection to the GCS")
    await flight.clock.advance(READY_TIMEOUT_S + 0.1)
    with pytest.raises(VehicleError, match=r"no readiness to arm within 60 s .*No connection to the GCS"):
        await call


async def test_setpoints_flow_before_offboard_is_asked_for_and_arming_waits_for_the_heartbeat(flight):
    call = await flight.take_off()
    await flight.clock.advance(STREAM_BEFORE_S - 0.05)
    assert flight.commands == []
    assert len(flight.wire.setpoints) >= 9
    await flight.clock.advance(0.1)
    assert modes_asked(flight) == [(1.0, 6.0, 0.0)]
    await flight.clock.advance(2.0)
    assert flight.commands == [SET_MODE], "an acknowledged mode is not yet a mode"
    heartbeat(flight, OFFBOARD, armed=False)
    await settle()
    assert flight.commands == [SET_MODE, ARM]
    assert (flight.wire.commands[1].param1, flight.wire.commands[1].param2) == (1.0, 0.0), "never a forced arming"
    assert not call.done()


async def test_a_vehicle_that_already_flies_there_enters_offboard_and_is_not_armed_again(flight):
    heartbeat(flight, LOITER, armed=True)
    flight.says.at_height(ALTITUDE_M)
    call = await flight.take_off()
    await flight.clock.advance(STREAM_BEFORE_S + 0.05)
    assert not call.done()
    heartbeat(flight, OFFBOARD, armed=True)
    await settle()
    assert call.exception() is None
    assert flight.commands == [SET_MODE]


async def test_the_climb_is_a_place_whose_altitude_rises_slowly_once_armed(flight):
    call = await climbing(flight)
    armed_s = flight.clock.now_s()
    for _ in range(40):
        heartbeat(flight, OFFBOARD)
        await flight.clock.advance(0.25)
    sent = flight.wire.setpoints
    assert {(m.message.lat_int, m.message.lon_int) for m in sent} == {(474_000_000, 85_000_000)}
    assert {m.message.type_mask for m in sent} == {0x05F8}
    assert {m.message.coordinate_frame for m in sent} == {mavlink.MAV_FRAME_GLOBAL_INT}
    heights = [(at.time_s, at.message.alt - HOME_AMSL_M) for at in sent]
    assert all(height == pytest.approx(0.0) for time_s, height in heights if time_s < armed_s)
    speeds = [(later[1] - earlier[1]) / 0.1 for earlier, later in itertools.pairwise(heights)]
    assert min(speeds) >= 0.0
    assert max(speeds) <= CLIMB_MPS + 0.01
    assert max(later - earlier for earlier, later in itertools.pairwise(speeds)) < 0.12, "a jump in vertical speed"
    assert heights[-1][1] == pytest.approx(ALTITUDE_M, abs=0.01)
    assert not call.done(), "the altitude asked for is not the altitude reached"
    flight.says.at_height(9.6)
    await settle()
    assert call.done()
    assert call.exception() is None
    assert modes_asked(flight) == [(1.0, 6.0, 0.0)]


async def test_the_stream_of_a_take_off_has_no_gap(flight):
    call = await climbing(flight)
    for height_m in (0.0, 3.0, 6.0, 9.6):
        heartbeat(flight, OFFBOARD)
        flight.says.at_height(height_m)
        await flight.clock.advance(1.0)
    assert call.done()
    times = [sent.time_s for sent in flight.wire.setpoints]
    assert max(later - earlier for earlier, later in itertools.pairwise(times)) < 0.15


async def test_offboard_that_no_heartbeat_shows_ends_in_an_error_never_arms_and_ends_the_stream(flight):
    call = await flight.take_off()
    for _ in range(7):
        heartbeat(flight, POSCTL, armed=False)
        await flight.clock.advance(1.0)
    with pytest.raises(VehicleError, match="no heartbeat in OFFBOARD within 5 s"):
        await call
    assert flight.commands == [SET_MODE]
    left = len(flight.wire.setpoints)
    await flight.clock.advance(5.0)
    assert len(flight.wire.setpoints) == left


async def test_a_refused_arming_is_not_tried_again_and_says_why(flight):
    flight.copter.results[ARM] = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    flight.copter.reasons[ARM] = "Arming denied: Resolve system health failures first"
    call = await flight.take_off()
    await flight.clock.advance(STREAM_BEFORE_S)
    heartbeat(flight, OFFBOARD, armed=False)
    await flight.clock.advance(30.0)
    with pytest.raises(VehicleError, match=r"arming refused with MAV_RESULT_TEMPORARILY_REJECTED .*Resolve system"):
        await call
    assert flight.commands == [SET_MODE, ARM]


async def test_a_pilot_who_takes_over_the_climb_gets_not_one_more_setpoint_and_no_mode(flight):
    call = await climbing(flight)
    await flight.clock.advance(2.0)
    heartbeat(flight, POSCTL)
    left = len(flight.wire.setpoints)
    heartbeat(flight, OFFBOARD)
    await flight.clock.advance(10.0)
    with pytest.raises(VehicleError, match="left OFFBOARD during its take-off"):
        await call
    assert len(flight.wire.setpoints) == left
    assert modes_asked(flight) == [(1.0, 6.0, 0.0)]


async def test_a_climb_that_is_given_up_holds_in_loiter(flight):
    call = await climbing(flight)
    await flight.clock.advance(2.0)
    call.cancel()
    await settle()
    assert modes_asked(flight)[1:] == [(1.0, 4.0, 3.0)]
    left = len(flight.wire.setpoints)
    await flight.clock.advance(5.0)
    assert len(flight.wire.setpoints) == left


async def test_a_climb_that_does_not_arrive_is_an_error_and_holds(flight):
    call = await climbing(flight)
    for _ in range(41):
        heartbeat(flight, OFFBOARD)
        flight.says.at_height(4.0)
        await flight.clock.advance(1.0)
    with pytest.raises(VehicleError, match="no climb to 10 m within 40 s"):
        await call
    assert modes_asked(flight)[1:] == [(1.0, 4.0, 3.0)]


async def test_holding_asks_for_loiter_ahead_of_everything(flight):
    flight.vehicle.tell(SET_INTERVAL, 33, 1e5)
    flight.autopilot.hold(flight.vehicle)
    await settle()
    assert flight.commands == [SET_MODE, SET_INTERVAL]
    assert modes_asked(flight) == [(1.0, 4.0, 3.0)]


@pytest.mark.parametrize(("method", "mode", "sub_mode"), [("land", LAND, 6.0), ("return_home", RTL, 5.0)])
async def test_landing_and_returning_wait_until_disarmed(flight, method, mode, sub_mode):
    heartbeat(flight, OFFBOARD)
    call = await flight.start(getattr(flight.autopilot, method)(flight.vehicle))
    assert modes_asked(flight) == [(1.0, 4.0, sub_mode)]
    heartbeat(flight, mode)
    await flight.clock.advance(20.0)
    assert not call.done()
    heartbeat(flight, mode, armed=False)
    await settle()
    assert call.done()
    assert call.exception() is None
