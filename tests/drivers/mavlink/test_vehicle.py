"""A vehicle is what its telemetry says; a command is sent once and its answer believed."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import VehicleError
from drivers.mavlink.link import Setpoint
from drivers.mavlink.vehicle import ACK_TIMEOUT_S, OVERTAKEN_S, Battery
from tests.fakes import settle

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
ACCEPTED, DENIED, IN_PROGRESS = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_IN_PROGRESS


@pytest.fixture
def vehicle(rig):
    return rig.vehicle()


@pytest.fixture
async def start():
    """How to start a call that waits; what is left of it is cancelled."""
    tasks = []

    async def start(coroutine):
        tasks.append(asyncio.create_task(coroutine))
        await settle()
        return tasks[-1]

    yield start
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def test_nothing_is_known_before_the_first_message(rig, vehicle):
    assert (vehicle.armed, vehicle.custom_mode) == (False, None)
    assert vehicle.telemetry.kinematics is None
    assert vehicle.silent_for_s() == float("inf")


async def test_telemetry_holds_the_latest_of_everything_and_when_it_came(rig, vehicle):
    rig.copter.heartbeat(mode=5, armed=False)
    rig.copter.heartbeat(mode=4, armed=True)
    rig.copter.at_height(12.5)
    rig.copter.estimator(831)
    rig.copter.text("EKF3 IMU0 is using GPS")
    telemetry = vehicle.telemetry
    assert (vehicle.armed, vehicle.custom_mode) == (True, 4)
    assert telemetry.relative_altitude_m == pytest.approx(12.5)
    assert telemetry.kinematics.position.latitude_deg == pytest.approx(47.4)
    assert telemetry.kinematics.position.longitude_deg == pytest.approx(8.5)
    assert telemetry.kinematics.position.altitude_m == pytest.approx(430.0)
    assert telemetry.kinematics.velocity_ned_mps == pytest.approx((1.5, -2.5, 0.5))
    assert telemetry.estimator_flags == 831
    assert list(telemetry.status_texts) == ["EKF3 IMU0 is using GPS"]
    assert telemetry.heartbeat.time_s == telemetry.kinematics.time_s == rig.clock.now_s()


async def test_silence_is_measured_by_the_clock_from_the_last_message_of_any_kind(rig, vehicle):
    rig.copter.heartbeat()
    await rig.clock.advance(0.7)
    assert vehicle.silent_for_s() == pytest.approx(0.7)
    rig.copter.at_height(1.0)
    assert vehicle.silent_for_s() == 0.0


async def test_listeners_get_every_heartbeat_and_position(rig, vehicle):
    modes, places = [], []
    vehicle.on_heartbeat.append(lambda heartbeat: modes.append(heartbeat.custom_mode))
    vehicle.on_kinematics.append(places.append)
    for mode in (4, 17, 4):
        rig.copter.heartbeat(mode=mode)
    rig.copter.at_height(3.0)
    assert modes == [4, 17, 4]
    assert places == [vehicle.telemetry.kinematics]


async def test_only_the_last_texts_are_kept(rig, vehicle):
    for number in range(500):
        rig.copter.text(f"text {number}")
    assert len(vehicle.telemetry.status_texts) <= 20
    assert vehicle.telemetry.status_texts[-1] == "text 499"


async def test_a_command_goes_once_to_the_autopilot_of_the_vehicle_and_returns_when_accepted(rig, vehicle, start):
    call = await start(vehicle.command(ARM, 1.0, what="arming"))
    assert not call.done()
    rig.copter.acknowledge(ARM, ACCEPTED)
    await settle()
    assert call.done()
    assert call.exception() is None
    (sent,) = rig.wire.commands
    assert (sent.target_system, sent.target_component, sent.command, sent.confirmation) == (1, 1, ARM, 0)
    assert [sent.param1, sent.param2, sent.param7] == [1.0, 0.0, 0.0]


async def test_a_refusal_is_an_error_with_the_autopilots_own_words(rig, vehicle, start):
    call = await start(vehicle.command(ARM, 1.0, what="arming"))
    rig.copter.text("Arm: Compass not healthy")
    rig.copter.acknowledge(ARM, DENIED)
    await settle()
    with pytest.raises(VehicleError) as caught:
        await call
    said = str(caught.value)
    for words in ("U1", "udpin:127.0.0.1:14550", "arming refused", "MAV_RESULT_DENIED", "Arm: Compass not healthy"):
        assert words in said
    assert caught.value.vehicle == "U1"
    assert caught.value.link == "udpin:127.0.0.1:14550"
    assert caught.value.way_out
    await rig.clock.advance(10.0)
    assert len(rig.wire.commands) == 1


async def test_a_result_nobody_has_heard_of_is_a_refusal(rig, vehicle, start):
    call = await start(vehicle.command(ARM, 1.0, what="arming"))
    rig.copter.acknowledge(ARM, 200)
    await settle()
    with pytest.raises(VehicleError, match="arming refused with 200"):
        await call


async def test_no_answer_is_an_error_naming_vehicle_link_and_way_out_and_nothing_is_sent_again(rig, vehicle, start):
    call = await start(vehicle.command(ARM, 1.0, what="arming"))
    await rig.clock.advance(ACK_TIMEOUT_S - 0.01)
    assert not call.done()
    await rig.clock.advance(0.02)
    with pytest.raises(
        VehicleError, match=r"U1 on udpin:127\.0\.0\.1:14550: arming not acknowledged within 3 s\. Check the link"
    ):
        await call
    await rig.clock.advance(30.0)
    assert len(rig.wire.commands) == 1


async def test_an_answer_to_another_command_or_from_another_vehicle_is_no_answer(rig, vehicle, start):
    call = await start(vehicle.command(ARM, 1.0, what="arming"))
    rig.copter.acknowledge(mavlink.MAV_CMD_NAV_TAKEOFF, ACCEPTED)
    rig.speaker(2).acknowledge(ARM, ACCEPTED)
    rig.speaker(1, 191).acknowledge(ARM, ACCEPTED)
    await settle()
    assert not call.done()


async def test_in_progress_is_no_answer_yet(rig, vehicle, start):
    call = await start(vehicle.command(ARM, 1.0, what="arming"))
    rig.copter.acknowledge(ARM, IN_PROGRESS)
    await settle()
    assert not call.done()
    rig.copter.acknowledge(ARM, ACCEPTED)
    await settle()
    assert call.done()
    assert call.exception() is None


async def test_late_doubled_and_unasked_answers_do_no_harm(rig, vehicle, start):
    rig.copter.acknowledge(ARM, ACCEPTED)
    call = await start(vehicle.command(ARM, 1.0, what="arming"))
    assert not call.done()
    rig.copter.acknowledge(ARM, ACCEPTED)
    rig.copter.acknowledge(ARM, DENIED)
    await settle()
    rig.copter.acknowledge(ARM, DENIED)
    assert call.exception() is None


async def test_an_answer_after_its_time_out_does_not_answer_the_next_command_of_its_number(rig, vehicle, start):
    late = await start(vehicle.command(ARM, 1.0, what="arming"))
    await rig.clock.advance(ACK_TIMEOUT_S + 0.1)
    with pytest.raises(VehicleError, match="not acknowledged"):
        await late
    with pytest.raises(VehicleError, match=r"arming not sent: .*its answer may still come.*Wait"):
        await vehicle.command(ARM, 1.0, what="arming")
    assert len(rig.wire.commands) == 1
    rig.copter.acknowledge(ARM, ACCEPTED)
    call = await start(vehicle.command(ARM, 1.0, what="arming"))
    assert not call.done()
    rig.copter.acknowledge(ARM, DENIED)
    await settle()
    with pytest.raises(VehicleError, match="refused"):
        await call


async def test_the_answer_to_a_command_told_does_not_answer_one_that_waits(rig, vehicle, start):
    vehicle.tell(ARM, 0.0)
    with pytest.raises(VehicleError, match="not sent"):
        await vehicle.command(ARM, 1.0, what="arming")
    rig.copter.acknowledge(ARM, ACCEPTED)
    assert not (await start(vehicle.command(ARM, 1.0, what="arming"))).done()


async def test_telling_waits_for_nothing(rig, vehicle):
    vehicle.tell(ARM, 0.0)
    await settle()
    assert [sent.command for sent in rig.wire.commands] == [ARM]


async def test_an_urgent_command_leaves_first_and_takes_the_waiting_setpoint_with_it(rig, vehicle):
    vehicle.tell(ARM, 1.0)
    rig.link.post_setpoint(
        1,
        Setpoint(
            mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0x05C7, *(0,) * 3, 5, *(0,) * 7),
            expires_s=float("inf"),
            stops=False,
        ),
    )
    vehicle.tell_urgently(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 17.0)
    await settle()
    assert [message.command for message in rig.wire.messages] == [mavlink.MAV_CMD_DO_SET_MODE, ARM]


async def test_waiting_returns_as_soon_as_telemetry_makes_it_true(rig, vehicle, start):
    call = await start(vehicle.wait_until(lambda: vehicle.armed, 5.0, "armed heartbeat", "Look."))
    rig.copter.heartbeat(armed=False)
    await settle()
    assert not call.done()
    rig.copter.heartbeat(armed=True)
    await settle()
    assert call.done()
    assert call.exception() is None


async def test_waiting_for_what_already_holds_returns_at_once(rig, vehicle):
    await asyncio.wait_for(vehicle.wait_until(lambda: True, 0.0, "nothing", "Look."), 1.0)


async def test_waiting_ends_by_the_clock_with_what_was_awaited_even_while_messages_come(rig, vehicle, start):
    call = await start(vehicle.wait_until(lambda: vehicle.armed, 5.0, "armed heartbeat", "See the messages."))
    rig.copter.text("PreArm: no")
    for _ in range(49):
        rig.copter.heartbeat(armed=False)
        await rig.clock.advance(0.1)
    assert not call.done()
    await rig.clock.advance(0.2)
    with pytest.raises(
        VehicleError, match=r"U1 on .*: no armed heartbeat within 5 s .*PreArm: no.*\. See the messages\."
    ):
        await call


async def test_two_may_wait_at_once(rig, vehicle, start):
    armed = await start(vehicle.wait_until(lambda: vehicle.armed, 5.0, "armed", "-"))
    guided = await start(vehicle.wait_until(lambda: vehicle.custom_mode == 4, 5.0, "guided", "-"))
    rig.copter.heartbeat(mode=5, armed=True)
    await settle()
    assert (armed.done(), guided.done()) == (True, False)
    rig.copter.heartbeat(mode=4, armed=True)
    await settle()
    assert guided.done()


async def test_nobody_sleeps_on_after_a_wait_or_a_command_has_ended(rig, vehicle, start):
    sleeping = rig.clock.sleeping
    call = await start(vehicle.command(ARM, 1.0, what="arming"))
    wait = await start(vehicle.wait_until(lambda: vehicle.armed, 5.0, "armed", "-"))
    rig.copter.acknowledge(ARM)
    rig.copter.heartbeat()
    await settle()
    assert call.done()
    assert wait.done()
    cancelled = await start(vehicle.command(ARM, 1.0, what="arming"))
    cancelled.cancel()
    await settle()
    assert rig.clock.sleeping == sleeping


def position(boot_s, height_m=10.0):
    return mavlink.MAVLink_global_position_int_message(
        round(boot_s * 1000), 474_000_000, 85_000_000, 430_000, round(height_m * 1000), 0, 0, 0, 0
    )


def rates_asked(rig):
    return [int(sent.param1) for sent in rig.wire.commands if sent.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL]


async def test_a_position_that_was_overtaken_is_not_taken(rig, vehicle):
    places = []
    vehicle.on_kinematics.append(places.append)
    rig.copter.say(position(100.0, 10.0))
    rig.copter.say(position(100.4, 10.4))
    rig.copter.say(position(100.2, 10.2))
    assert vehicle.telemetry.relative_altitude_m == pytest.approx(10.4)
    assert len(places) == 2
    assert vehicle.reboots == 0


@pytest.mark.parametrize(
    ("latitude_e7", "longitude_e7"), [(900_000_001, 0), (0, -1_800_000_001), (2**31 - 1, 2**31 - 1)]
)
async def test_a_place_that_is_not_on_earth_is_not_taken(rig, vehicle, latitude_e7, longitude_e7):
    rig.copter.say(mavlink.MAVLink_global_position_int_message(5, latitude_e7, longitude_e7, 0, 0, 0, 0, 0, 0))
    assert vehicle.telemetry.kinematics is None


async def test_positions_older_than_one_of_an_earlier_boot_that_strayed_in_are_taken_after_some_seconds(rig, vehicle):
    rig.copter.say(position(2.0))
    rig.copter.say(position(300.0))
    await rig.clock.advance(OVERTAKEN_S + 0.1)
    rig.copter.say(position(2.0 + OVERTAKEN_S, 3.0))
    assert vehicle.telemetry.relative_altitude_m == pytest.approx(3.0)


REBOOTS = {
    "its clock in a position": lambda copter: copter.say(position(2.0)),
    "its clock in the system time": lambda copter: copter.say(mavlink.MAVLink_system_time_message(0, 2000)),
    "its clock in an answer to TIMESYNC": lambda copter: copter.say(
        mavlink.MAVLink_timesync_message(2_000_000_000, 77)
    ),
    "its clock in its own TIMESYNC": lambda copter: copter.say(mavlink.MAVLink_timesync_message(0, 2_000_000_000)),
    "a heartbeat that says so": lambda copter: copter.heartbeat(status=mavlink.MAV_STATE_BOOT),
}


@pytest.mark.parametrize("told_by", REBOOTS)
async def test_a_reboot_is_counted_and_said_and_every_rate_is_asked_for_again_without_waiting(rig, vehicle, told_by):
    notices = []
    vehicle.on_notice.append(notices.append)
    vehicle.rates.ask({33: 5.0, 193: 1.0})
    rig.copter.heartbeat()
    rig.copter.say(position(300.0))
    rig.copter.estimator(831)
    rig.copter.health(0xFFFF)
    await rig.clock.advance(4.0)
    rig.wire.sent.clear()
    REBOOTS[told_by](rig.copter)
    await settle()
    assert vehicle.reboots == 1
    assert notices == ["U1 has rebooted"]
    assert rates_asked(rig) == [33, 193]
    assert (vehicle.telemetry.estimator_flags, vehicle.telemetry.sensors_healthy) == (0, 0)
    rig.copter.say(position(2.4))
    rig.copter.heartbeat(status=mavlink.MAV_STATE_BOOT)
    rig.copter.say(position(2.6, 0.5))
    assert vehicle.telemetry.relative_altitude_m == pytest.approx(0.5)
    assert vehicle.reboots == 1, "several signs of one reboot"
    await rig.clock.advance(60.0)
    rig.copter.say(position(1.0))
    assert vehicle.reboots == 2


async def test_a_vehicle_that_boots_when_it_is_first_heard_has_not_rebooted(rig, vehicle):
    rig.copter.heartbeat(status=mavlink.MAV_STATE_BOOT)
    rig.copter.heartbeat(status=mavlink.MAV_STATE_BOOT)
    rig.copter.heartbeat(status=mavlink.MAV_STATE_STANDBY)
    assert vehicle.reboots == 0


async def test_heartbeats_without_the_messages_asked_for_make_it_ask_again_and_say_so(rig, vehicle):
    notices = []
    vehicle.on_notice.append(notices.append)
    vehicle.rates.ask({33: 5.0})
    rig.copter.say(position(300.0))
    await settle()
    rig.wire.sent.clear()
    for _ in range(6):
        await rig.clock.advance(1.0)
        rig.copter.heartbeat()
    await settle()
    assert rates_asked(rig) == [33]
    assert notices == ["U1 stopped sending what was asked of it, and was asked again"]
    rig.copter.say(position(4.0))
    assert vehicle.reboots == 1, "what it then sends shows that its clock began again"


async def test_the_battery_is_what_is_measured_of_it(rig, vehicle):
    rig.copter.say(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 16200, -1, 81, *(0,) * 6))
    assert vehicle.telemetry.battery == Battery(81, pytest.approx(16.2))
    rig.copter.say(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0, -1, -1, *(0,) * 6))
    assert vehicle.telemetry.battery == Battery(None, None)


async def test_a_listener_hears_messages_of_its_kind_while_its_block_lasts(rig, vehicle):
    heard = []
    with vehicle.hearing(mavlink.MAVLINK_MSG_ID_TIMESYNC, heard.append):
        rig.copter.say(mavlink.MAVLink_timesync_message(5, 6))
        rig.copter.heartbeat()
    rig.copter.say(mavlink.MAVLink_timesync_message(7, 8))
    assert [message.tc1 for message in heard] == [5]
