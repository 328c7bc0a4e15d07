"""ArduCopter, against a copter that acknowledges one thing and does another."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import VehicleError
from drivers.mavlink.autopilots import autopilot_of
from drivers.mavlink.autopilots.ardupilot import READY_TIMEOUT_S, ArduCopter
from drivers.mavlink.link import Setpoint
from drivers.mavlink.vehicle import Heartbeat
from tests.drivers.mavlink.scripted import Flight
from tests.fakes import settle

SET_MODE, ARM, TAKE_OFF = (
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_NAV_TAKEOFF,
)
SET_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
STABILIZE, GUIDED, LOITER, RTL, LAND, BRAKE = 0, 4, 5, 6, 9, 17
READY = mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_HORIZ
ALTITUDE_M = 10.0


@pytest.fixture
async def flight(rig):
    flight = Flight(rig, ArduCopter(), ALTITUDE_M)
    flight.says.heartbeat(mode=STABILIZE, armed=False)
    yield flight
    await flight.close()


def test_only_guided_is_guided():
    heartbeats = [Heartbeat(0.0, 2, 3, mode, armed=True, system_status=4) for mode in range(30)]
    assert [heartbeat.custom_mode for heartbeat in heartbeats if ArduCopter().is_guided(heartbeat)] == [GUIDED]


async def test_preparing_asks_for_position_estimator_and_health_at_their_rates(flight):
    await flight.start(flight.autopilot.prepare(flight.vehicle))
    asked = {int(message.param1): message.param2 for message in flight.wire.commands}
    assert set(flight.commands) == {SET_INTERVAL}
    assert asked == {
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 200_000.0,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 1_000_000.0,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1_000_000.0,
    }


async def test_a_vehicle_is_ready_only_with_an_absolute_position_estimate_and_a_position(flight):
    call = await flight.start(flight.autopilot.prepare(flight.vehicle))
    flight.says.heartbeat(mode=STABILIZE, armed=False)
    flight.says.at_height(0.0)
    flight.says.estimator(mavlink.EKF_CONST_POS_MODE | mavlink.EKF_ATTITUDE)
    await settle()
    assert not call.done()
    flight.says.estimator(READY)
    await settle()
    assert call.done()
    assert call.exception() is None


async def test_an_estimate_without_any_position_is_not_ready(flight):
    call = await flight.start(flight.autopilot.prepare(flight.vehicle))
    flight.says.estimator(READY)
    await settle()
    assert not call.done()


async def test_a_vehicle_that_never_finds_its_position_is_an_error(flight):
    call = await flight.start(flight.autopilot.prepare(flight.vehicle))
    flight.says.text("PreArm: GPS 1: Bad fix")
    await flight.clock.advance(READY_TIMEOUT_S + 0.1)
    with pytest.raises(VehicleError, match=r"U1 .*no position estimate within 90 s .*Bad fix.*GPS"):
        await call


async def test_a_refused_rate_is_no_reason_to_wait_in_vain_for_what_comes_unasked(flight):
    flight.copter.results[SET_INTERVAL] = mavlink.MAV_RESULT_DENIED
    call = await flight.start(flight.autopilot.prepare(flight.vehicle))
    flight.says.at_height(0.0)
    flight.says.estimator(READY)
    await settle()
    assert call.done()
    assert call.exception() is None


async def test_take_off_is_guided_then_arm_then_climb_each_once_and_waits_for_what_the_heartbeat_shows(flight):
    call = await flight.take_off()
    assert flight.commands == [SET_MODE]
    assert (flight.wire.commands[0].param1, flight.wire.commands[0].param2) == (1.0, GUIDED)
    flight.says.heartbeat(mode=GUIDED, armed=False)
    await settle()
    assert flight.commands == [SET_MODE, ARM]
    assert flight.wire.commands[1].param1 == 1.0
    assert flight.wire.commands[1].param2 == 0.0, "never a forced arming"
    await flight.clock.advance(0.9)
    assert flight.commands == [SET_MODE, ARM], "take-off before the heartbeat says armed"
    flight.says.heartbeat(mode=GUIDED, armed=True)
    await settle()
    assert flight.commands == [SET_MODE, ARM, TAKE_OFF]
    assert flight.wire.commands[2].param7 == ALTITUDE_M
    for height_m in (0.0, 3.0, 6.0, 9.4):
        flight.says.at_height(height_m)
        await flight.clock.advance(1.0)
        assert not call.done()
    flight.says.at_height(9.6)
    await settle()
    assert call.done()
    assert call.exception() is None
    assert flight.commands == [SET_MODE, ARM, TAKE_OFF]


async def test_a_copter_that_already_flies_there_only_enters_guided(flight):
    flight.says.heartbeat(mode=LOITER, armed=True)
    flight.says.at_height(ALTITUDE_M)
    call = await flight.take_off()
    assert not call.done()
    flight.says.heartbeat(mode=GUIDED, armed=True)
    await settle()
    assert call.exception() is None
    assert flight.commands == [SET_MODE]


async def test_no_setpoint_leaves_during_take_off(flight):
    call = await flight.take_off()
    for height_m in range(11):
        flight.says.heartbeat(mode=GUIDED, armed=True)
        flight.says.at_height(float(height_m))
        await flight.clock.advance(1.0)
    assert call.done()
    assert flight.wire.setpoints == []


async def test_an_acknowledged_mode_that_no_heartbeat_shows_ends_in_an_error_and_never_arms(flight):
    call = await flight.take_off()
    for _ in range(6):
        flight.says.heartbeat(mode=STABILIZE, armed=False)
        await flight.clock.advance(1.0)
    with pytest.raises(VehicleError, match=r"U1 .*no heartbeat in GUIDED within 5 s"):
        await call
    assert flight.commands == [SET_MODE]


async def test_a_mode_that_only_the_heartbeat_shows_is_believed(flight):
    flight.copter.mute.add(SET_MODE)
    await flight.take_off()
    flight.says.heartbeat(mode=GUIDED, armed=False)
    await settle()
    assert flight.commands == [SET_MODE, ARM]


async def test_a_refused_arming_is_not_tried_again_and_says_why(flight):
    flight.copter.results[ARM] = mavlink.MAV_RESULT_FAILED
    flight.copter.reasons[ARM] = "Arm: Gyros inconsistent"
    call = await flight.take_off()
    flight.says.heartbeat(mode=GUIDED, armed=False)
    await flight.clock.advance(30.0)
    with pytest.raises(VehicleError, match=r"arming refused with MAV_RESULT_FAILED .*Arm: Gyros inconsistent"):
        await call
    assert flight.commands == [SET_MODE, ARM]


async def test_an_unanswered_arming_is_not_tried_again(flight):
    flight.copter.mute.add(ARM)
    call = await flight.take_off()
    flight.says.heartbeat(mode=GUIDED, armed=False)
    await flight.clock.advance(30.0)
    with pytest.raises(VehicleError, match="arming not acknowledged"):
        await call
    assert flight.commands == [SET_MODE, ARM]


async def test_an_acknowledged_arming_that_no_heartbeat_shows_never_takes_off(flight):
    call = await flight.take_off()
    for _ in range(7):
        flight.says.heartbeat(mode=GUIDED, armed=False)
        await flight.clock.advance(1.0)
    with pytest.raises(VehicleError, match="no armed heartbeat within 5 s"):
        await call
    assert flight.commands == [SET_MODE, ARM]


async def test_a_refused_take_off_is_an_error(flight):
    flight.copter.results[TAKE_OFF] = mavlink.MAV_RESULT_DENIED
    call = await flight.take_off()
    flight.says.heartbeat(mode=GUIDED, armed=True)
    await settle()
    with pytest.raises(VehicleError, match="take-off refused"):
        await call


async def test_a_climb_that_does_not_arrive_is_an_error(flight):
    call = await flight.take_off()
    flight.says.heartbeat(mode=GUIDED, armed=True)
    flight.says.at_height(4.0)
    await flight.clock.advance(41.0)
    with pytest.raises(VehicleError, match="no climb to 10 m within 40 s"):
        await call


async def test_hold_asks_for_brake_ahead_of_everything_and_drops_the_waiting_setpoint(flight):
    flight.vehicle.tell(SET_INTERVAL, 33, 1e5)
    flight.rig.link.post_setpoint(
        1,
        Setpoint(
            mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0x05C7, *(0,) * 3, 5, *(0,) * 7),
            expires_s=float("inf"),
            stops=False,
        ),
    )
    flight.autopilot.hold(flight.vehicle)
    await settle()
    assert flight.commands == [SET_MODE, SET_INTERVAL]
    assert (flight.wire.commands[0].param1, flight.wire.commands[0].param2) == (1.0, BRAKE)
    assert flight.wire.setpoints == []


async def test_landing_is_asked_for_ahead_of_everything_and_waits_until_disarmed(flight):
    async def ask_and_land():
        flight.vehicle.tell(SET_INTERVAL, 33, 1e5)
        await flight.autopilot.land(flight.vehicle)

    flight.says.heartbeat(mode=GUIDED, armed=True)
    call = await flight.start(ask_and_land())
    assert flight.commands == [SET_MODE, SET_INTERVAL]
    assert (flight.wire.commands[0].param1, flight.wire.commands[0].param2) == (1.0, LAND)
    flight.says.heartbeat(mode=LAND, armed=True)
    await flight.clock.advance(20.0)
    assert not call.done()
    flight.says.heartbeat(mode=LAND, armed=False)
    await settle()
    assert call.done()
    assert call.exception() is None


async def test_a_return_is_asked_for_as_rtl_and_waits_until_disarmed(flight):
    flight.says.heartbeat(mode=GUIDED, armed=True)
    call = await flight.start(flight.autopilot.return_home(flight.vehicle))
    assert [(message.param1, message.param2) for message in flight.wire.commands] == [(1.0, RTL)]
    flight.says.heartbeat(mode=RTL, armed=True)
    await flight.clock.advance(100.0)
    assert not call.done()
    flight.says.heartbeat(mode=RTL, armed=False)
    await settle()
    assert call.done()
    assert call.exception() is None


async def test_a_landing_that_does_not_end_is_an_error(flight):
    flight.says.heartbeat(mode=GUIDED, armed=True)
    call = await flight.start(flight.autopilot.land(flight.vehicle))
    await flight.clock.advance(121.0)
    with pytest.raises(VehicleError, match=r"no touch-down within 120 s.*by hand"):
        await call


async def test_the_strategy_follows_from_the_heartbeat(rig):
    vehicle = rig.vehicle()
    with pytest.raises(VehicleError, match="has not sent a heartbeat"):
        autopilot_of(vehicle)
    rig.copter.heartbeat()
    assert isinstance(autopilot_of(vehicle), ArduCopter)


@pytest.mark.parametrize(
    ("autopilot", "vehicle_type", "words"),
    [
        (mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_GCS, "gcs with invalid"),
        (mavlink.MAV_AUTOPILOT_GENERIC, mavlink.MAV_TYPE_QUADROTOR, "quadrotor with generic"),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_FIXED_WING, "a plane with ArduPilot"),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_GROUND_ROVER, "a rover with ArduPilot"),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_SUBMARINE, "a submarine with ArduPilot"),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_AIRSHIP, "a blimp with ArduPilot"),
        (mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_GROUND_ROVER, "a rover with PX4"),
    ],
)
async def test_what_cannot_be_flown_is_refused_in_words_and_numbers(rig, autopilot, vehicle_type, words):
    vehicle = rig.vehicle()
    rig.copter.heartbeat(autopilot=autopilot, vehicle_type=vehicle_type)
    with pytest.raises(
        VehicleError,
        match=rf"U1 .*is {words} \(vehicle type {vehicle_type}, autopilot {autopilot}\), which is not supported\. "
        "It flies multicopters with ArduPilot or PX4",
    ):
        autopilot_of(vehicle)


async def test_a_playbook_that_names_the_autopilot_has_to_be_right(rig):
    vehicle = rig.vehicle()
    rig.copter.heartbeat()
    assert isinstance(autopilot_of(vehicle, "ardupilot"), ArduCopter)
    with pytest.raises(VehicleError, match=r"is ArduPilot, and the playbook names PX4\. Correct"):
        autopilot_of(vehicle, "px4")


async def test_a_playbook_may_name_the_autopilot_of_a_vehicle_that_does_not(rig):
    vehicle = rig.vehicle()
    rig.copter.heartbeat(autopilot=mavlink.MAV_AUTOPILOT_GENERIC)
    assert isinstance(autopilot_of(vehicle, "ardupilot"), ArduCopter)
    rig.copter.heartbeat(autopilot=mavlink.MAV_AUTOPILOT_GENERIC, vehicle_type=mavlink.MAV_TYPE_GROUND_ROVER)
    with pytest.raises(VehicleError, match="a rover with generic"):
        autopilot_of(vehicle, "ardupilot")
