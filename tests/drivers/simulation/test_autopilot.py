"""How the simulated ArduCopter answers its stations: the rules of ArduCopter 4.6 a ground station relies on."""

from math import nan, pi

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
STABILIZE, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, LAND, BRAKE = 0, 2, 3, 4, 5, 6, 9, 17
ARM, TAKE_OFF = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF
GLOBAL_POSITION_INT = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT


def speed_after(bench, setpoint, duration_s=6.0):
    last = bench.run(duration_s, repeat=setpoint)[-1]
    return round(last.north_mps, 2), round(last.east_mps, 2)


class TestArming:
    def test_a_ready_copter_in_guided_arms_and_says_so(self, bench):
        bench.mode(GUIDED)
        assert bench.gcs.command(ARM, 1) == ACCEPTED
        assert "Arming motors" in bench.gcs.texts()
        bench.run(1)
        assert bench.gcs.last("HEARTBEAT").base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED

    def test_it_is_refused_with_the_reason_before_the_position_estimate_is_good(self, make_bench):
        bench = make_bench(ready_s=41.7)
        bench.mode(GUIDED)
        bench.run(41)
        assert not bench.gcs.last("EKF_STATUS_REPORT").flags & 16
        assert bench.gcs.command(ARM, 1) == FAILED
        assert bench.gcs.texts() == ["Arm: Need Position Estimate"]
        bench.run(2)
        assert bench.gcs.last("EKF_STATUS_REPORT").flags & 16
        assert bench.gcs.command(ARM, 1) == ACCEPTED

    @pytest.mark.parametrize("mode", [RTL, LAND, BRAKE])
    def test_it_is_refused_with_the_reason_in_a_mode_that_cannot_arm(self, bench, mode):
        bench.mode(mode)
        assert bench.gcs.command(ARM, 1) == FAILED
        assert bench.gcs.texts()[0].endswith("mode not armable")

    def test_arming_twice_is_accepted(self, bench):
        bench.gcs.command(ARM, 1)
        assert bench.gcs.command(ARM, 1) == ACCEPTED
        assert bench.gcs.texts() == []

    def test_an_idle_armed_copter_disarms_itself_after_ten_seconds(self, bench):
        bench.gcs.command(ARM, 1)
        bench.run(9.5)
        assert bench.flight.armed
        bench.run(1)
        assert not bench.flight.armed

    def test_disarming_is_refused_in_the_air_unless_forced(self, airborne):
        assert airborne.gcs.command(ARM, 0) == FAILED
        assert airborne.gcs.command(ARM, 0, 21196) == ACCEPTED
        assert airborne.run(10)[-1].height_m == 0.0

    def test_home_is_where_it_was_armed(self, bench, velocity):
        bench.take_off()
        bench.run(10, repeat=velocity(5))
        bench.mode(LAND)
        bench.run(60)
        bench.mode(GUIDED)
        assert bench.gcs.command(ARM, 1) == ACCEPTED
        assert bench.sample().north_m > 40
        assert bench.gcs.last("HOME_POSITION").x == pytest.approx(bench.sample().north_m)


class TestModes:
    @pytest.mark.parametrize("mode", [STABILIZE, ALT_HOLD, GUIDED, LOITER, RTL, LAND, BRAKE])
    def test_a_mode_is_accepted_and_the_heartbeat_tells_at_once(self, airborne, mode):
        airborne.mode(LOITER if mode == GUIDED else GUIDED)
        assert airborne.mode(mode) == ACCEPTED
        assert airborne.gcs.last("HEARTBEAT").custom_mode == mode

    def test_the_set_mode_message_does_the_same(self, bench):
        bench.gcs.send(mavlink.MAVLink_set_mode_message(3, 1, GUIDED))
        assert bench.gcs.last("HEARTBEAT").custom_mode == GUIDED
        assert bench.gcs.last("COMMAND_ACK").command == mavlink.MAVLINK_MSG_ID_SET_MODE

    @pytest.mark.parametrize(
        ("mode", "text"), [(AUTO, "Mode change to AUTO failed: no mission"), (99, "No such mode 99")]
    )
    def test_what_it_cannot_fly_is_refused_with_the_reason(self, bench, mode, text):
        assert bench.mode(mode) == FAILED
        assert bench.gcs.texts() == [text]
        assert bench.flight.mode == STABILIZE

    def test_every_station_hears_of_a_mode_change(self, bench):
        other = bench.add_station(254)
        bench.mode(GUIDED)
        assert other.last("HEARTBEAT").custom_mode == GUIDED
        assert other.all("COMMAND_ACK") == []

    def test_asking_for_guided_again_does_not_stop_it(self, airborne, velocity):
        airborne.run(10, repeat=velocity(5))
        airborne.mode(GUIDED)
        assert airborne.run(1)[-1].north_mps == pytest.approx(5, abs=0.2)

    def test_return_to_launch_climbs_flies_home_lands_and_disarms(self, make_bench, velocity):
        bench = make_bench(RTL_ALT=2000).take_off(height_m=10)
        bench.run(20, repeat=velocity(4, 3))
        assert bench.gcs.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
        samples = bench.run(120)
        assert max(s.height_m for s in samples) == pytest.approx(20, abs=0.5)
        assert (samples[-1].north_m, samples[-1].east_m) == pytest.approx((0, 0), abs=0.5)
        assert samples[-1].height_m == 0.0
        assert not bench.flight.armed

    def test_land_sinks_slowly_below_ten_metres_and_disarms(self, airborne):
        assert airborne.gcs.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
        samples = airborne.run(60)
        assert min(s.up_mps for s in samples) == pytest.approx(-1.5, abs=0.1)
        assert min(s.up_mps for s in samples if 0.1 < s.height_m < 9) == pytest.approx(-0.5, abs=0.1)
        assert not airborne.flight.armed

    def test_alt_hold_coasts_on_level(self, airborne, velocity):
        airborne.run(10, repeat=velocity(5))
        airborne.mode(ALT_HOLD)
        samples = airborne.run(5)
        assert 0.1 < samples[-1].north_mps < 4
        assert samples[-1].height_m == pytest.approx(30, abs=0.2)


class TestTakeOff:
    def test_it_is_refused_unless_armed_in_guided_on_the_ground(self, bench):
        assert bench.gcs.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 10) == FAILED
        bench.gcs.command(ARM, 1)
        assert bench.gcs.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 10) == FAILED
        bench.mode(GUIDED)
        assert bench.gcs.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, nan) == FAILED
        assert bench.gcs.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 10) == ACCEPTED
        bench.run(20)
        assert bench.gcs.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 10) == FAILED

    def test_a_velocity_stream_cancels_it_in_the_climb(self, bench, velocity):
        bench.take_off(height_m=20, settle_s=6)
        assert bench.run(20, repeat=velocity())[-1].height_m < 15

    def test_a_velocity_stream_cancels_it_before_the_lift_off(self, bench, velocity):
        bench.take_off(height_m=20, settle_s=1)
        assert bench.run(5, repeat=velocity(0, 0, -1))[-1].height_m == 0.0

    def test_a_velocity_does_not_lift_a_landed_copter(self, bench, velocity):
        bench.mode(GUIDED)
        assert bench.gcs.command(ARM, 1) == ACCEPTED
        assert bench.run(5, repeat=velocity(0, 0, -2))[-1].height_m == 0.0


class TestSetpoints:
    @pytest.mark.parametrize("frame", [1, 7])
    def test_frames_1_and_7_are_the_earth(self, make_bench, velocity, frame):
        bench = make_bench(heading_rad=pi / 2, WP_YAW_BEHAVIOR=0).take_off()
        assert speed_after(bench, velocity(2, 1, frame=frame)) == pytest.approx((2, 1), abs=0.1)

    @pytest.mark.parametrize("frame", [8, 9])
    def test_frames_8_and_9_are_the_body(self, make_bench, velocity, frame):
        bench = make_bench(heading_rad=pi / 2, WP_YAW_BEHAVIOR=0).take_off()
        assert speed_after(bench, velocity(2, 1, frame=frame)) == pytest.approx((-1, 2), abs=0.1)

    @pytest.mark.parametrize(
        "broken",
        [
            {"frame": 12},
            {"frame": 13},
            {"frame": 0},
            {"north_mps": nan},
            {"down_mps": nan},
            {"mask": 0x0DC7 | 0x08},
            {"mask": 0x0DC7 | 0x20},
            {"mask": 0x0C3F},
            {"mask": 0x05C7, "yaw_rate": nan},
        ],
        ids=str,
    )
    def test_what_it_cannot_obey_stops_it_silently(self, airborne, velocity, broken):
        airborne.run(10, repeat=velocity(5))
        airborne.gcs.heard.clear()
        assert speed_after(airborne, velocity(**{"north_mps": 5, **broken})) == pytest.approx((0, 0), abs=0.15)
        assert airborne.gcs.texts() == []
        assert airborne.flight.mode == GUIDED

    def test_outside_guided_it_is_dropped_silently(self, airborne, velocity):
        airborne.mode(LOITER)
        airborne.gcs.heard.clear()
        assert speed_after(airborne, velocity(5)) == (0, 0)
        assert airborne.gcs.texts() == airborne.gcs.all("COMMAND_ACK") == []

    def test_back_in_guided_a_running_stream_is_obeyed_at_once(self, airborne, velocity):
        airborne.mode(LOITER)
        airborne.run(3, repeat=velocity(5))
        airborne.mode(GUIDED)
        assert speed_after(airborne, velocity(5)) == pytest.approx((5, 0), abs=0.3)

    def test_another_systems_setpoint_is_ignored(self, airborne, velocity):
        assert speed_after(airborne, velocity(5, target=4)) == (0, 0)

    def test_target_zero_is_obeyed(self, airborne, velocity):
        assert speed_after(airborne, velocity(5, target=0)) == pytest.approx((5, 0), abs=0.3)

    def test_a_pause_ignores_setpoints_until_continue(self, airborne, velocity):
        assert airborne.gcs.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == ACCEPTED
        assert speed_after(airborne, velocity(5)) == (0, 0)
        assert airborne.gcs.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1) == ACCEPTED
        assert speed_after(airborne, velocity(5)) == pytest.approx((5, 0), abs=0.3)

    def test_a_pause_is_refused_outside_guided(self, airborne):
        airborne.mode(LOITER)
        assert airborne.gcs.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == FAILED

    def test_the_nose_follows_the_course(self, airborne, velocity):
        airborne.run(10, repeat=velocity(0, 3))
        assert airborne.flight.dynamics.heading_rad == pytest.approx(pi / 2, abs=0.05)

    def test_a_yaw_rate_of_zero_holds_the_nose(self, airborne, velocity):
        assert airborne.run(10, repeat=velocity(0, 3, mask=0x05C7))[-1].east_mps == pytest.approx(3, abs=0.2)
        assert airborne.flight.dynamics.heading_rad == 0.0

    def test_wp_yaw_behavior_zero_holds_the_nose(self, make_bench, velocity):
        bench = make_bench(WP_YAW_BEHAVIOR=0).take_off()
        assert bench.run(10, repeat=velocity(0, 3))[-1].east_mps == pytest.approx(3, abs=0.2)
        assert bench.flight.dynamics.heading_rad == 0.0

    def test_the_echo_tells_what_it_obeys(self, airborne, velocity):
        airborne.gcs.send(velocity(3, -1, 0.5))
        airborne.run(0.1)
        airborne.gcs.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 85)
        echo = airborne.gcs.last("POSITION_TARGET_LOCAL_NED")
        assert (echo.vx, echo.vy, echo.vz) == (3, -1, 0.5)
        airborne.run(5)
        airborne.gcs.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 85)
        echo = airborne.gcs.last("POSITION_TARGET_LOCAL_NED")
        assert (echo.vx, echo.vy, echo.vz) == (0, 0, 0)

    def test_a_position_is_flown_to_and_kept(self, airborne, position):
        airborne.gcs.send(position(20, -10, -15))
        last = airborne.run(30)[-1]
        assert (last.north_m, last.east_m, last.height_m) == pytest.approx((20, -10, 15), abs=0.1)

    def test_a_global_position_is_flown_to(self, airborne):
        north, east = 30.0, 40.0
        latitude_deg, longitude_deg = airborne.autopilot.vehicle.frame.to_degrees(north, east)
        e7 = round(latitude_deg * 1e7), round(longitude_deg * 1e7)
        airborne.gcs.send(
            mavlink.MAVLink_set_position_target_global_int_message(0, 3, 1, 6, 0x0DF8, *e7, 25, *[0.0] * 8)
        )
        last = airborne.run(40)[-1]
        assert (last.north_m, last.east_m, last.height_m) == pytest.approx((north, east, 25), abs=0.1)

    def test_reposition_flies_to_a_place(self, airborne):
        latitude_deg, longitude_deg = airborne.autopilot.vehicle.frame.to_degrees(10.0, 20.0)
        e7 = round(latitude_deg * 1e7), round(longitude_deg * 1e7)
        airborne.gcs.send(
            mavlink.MAVLink_command_int_message(3, 1, 3, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, -1, 0, 0, 0, *e7, 20)
        )
        assert airborne.gcs.last("COMMAND_ACK").result == ACCEPTED
        last = airborne.run(30)[-1]
        assert (last.north_m, last.east_m, last.height_m) == pytest.approx((10, 20, 20), abs=0.1)


class TestGcsFailsafe:
    @pytest.mark.parametrize(("enable", "mode"), [(1, RTL), (5, LAND), (7, BRAKE)])
    def test_it_acts_five_seconds_after_the_last_heartbeat(self, make_bench, velocity, enable, mode):
        bench = make_bench(FS_GCS_ENABLE=enable).take_off()
        bench.gcs.heartbeat()
        bench.run(4.9, repeat=velocity(1))
        assert bench.flight.mode == GUIDED
        bench.run(0.2, repeat=velocity(1))
        assert bench.flight.mode == mode
        assert bench.gcs.last("HEARTBEAT").custom_mode == mode
        assert "GCS Failsafe" in bench.gcs.texts()

    def test_the_mode_stays_when_the_station_returns(self, make_bench):
        bench = make_bench(FS_GCS_ENABLE=7).take_off()
        bench.gcs.heartbeat()
        bench.run(6)
        bench.gcs.heartbeat()
        assert bench.gcs.texts()[-1] == "GCS Failsafe Cleared"
        assert bench.flight.mode == BRAKE

    def test_it_is_off_by_default(self, airborne):
        airborne.gcs.heartbeat()
        airborne.run(20)
        assert airborne.flight.mode == GUIDED

    def test_a_station_never_heard_never_triggers_it(self, make_bench):
        bench = make_bench(FS_GCS_ENABLE=1).take_off()
        bench.run(20)
        assert bench.flight.mode == GUIDED

    def test_other_stations_neither_trigger_nor_feed_it(self, make_bench):
        bench = make_bench(FS_GCS_ENABLE=1).take_off()
        other = bench.add_station(254)
        other.heartbeat()
        bench.run(20)
        assert bench.flight.mode == GUIDED
        bench.gcs.heartbeat()
        for _ in range(6):
            bench.run(1)
            other.heartbeat()
        assert bench.flight.mode == RTL

    def test_on_the_ground_it_disarms(self, make_bench):
        bench = make_bench(FS_GCS_ENABLE=1)
        bench.gcs.heartbeat()
        bench.mode(GUIDED)
        assert bench.gcs.command(ARM, 1) == ACCEPTED
        bench.run(6)
        assert not bench.flight.armed

    def test_arming_is_refused_while_it_is_on(self, make_bench):
        bench = make_bench(FS_GCS_ENABLE=1)
        bench.gcs.heartbeat()
        bench.run(6)
        assert bench.gcs.command(ARM, 1) == FAILED
        assert bench.gcs.texts() == ["Arm: GCS failsafe on"]


class TestReports:
    def test_an_unasked_link_gets_a_heartbeat_a_second_and_slow_positions(self, bench):
        bench.run(10)
        assert len(bench.gcs.all("HEARTBEAT")) == 10
        assert len(bench.gcs.all("GLOBAL_POSITION_INT")) == 40

    def test_an_interval_holds_for_one_link_only(self, bench):
        other = bench.add_station(254)
        assert bench.gcs.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, GLOBAL_POSITION_INT, 50_000) == ACCEPTED
        bench.run(2)
        assert len(bench.gcs.all("GLOBAL_POSITION_INT")) == 40
        assert len(other.all("GLOBAL_POSITION_INT")) == 8

    def test_an_interval_of_minus_one_is_silence_and_zero_the_default(self, bench):
        bench.gcs.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, GLOBAL_POSITION_INT, -1)
        bench.run(2)
        assert bench.gcs.all("GLOBAL_POSITION_INT") == []
        bench.gcs.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, GLOBAL_POSITION_INT, 0)
        bench.run(2)
        assert len(bench.gcs.all("GLOBAL_POSITION_INT")) == 8

    def test_the_interval_of_an_unknown_message_is_denied(self, bench):
        assert bench.gcs.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 9999, 100_000) == DENIED

    def test_the_interval_in_use_is_told(self, bench):
        assert bench.gcs.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, GLOBAL_POSITION_INT) == ACCEPTED
        assert bench.gcs.last("MESSAGE_INTERVAL").interval_us == 250_000

    def test_a_data_stream_request_sets_the_rates_of_its_group(self, bench):
        bench.gcs.send(mavlink.MAVLink_request_data_stream_message(3, 1, mavlink.MAV_DATA_STREAM_ALL, 0, 0))
        bench.gcs.send(mavlink.MAVLink_request_data_stream_message(3, 1, mavlink.MAV_DATA_STREAM_POSITION, 10, 1))
        bench.gcs.heard.clear()
        bench.run(2)
        assert len(bench.gcs.all("GLOBAL_POSITION_INT")) == 20
        assert {m.get_type() for m in bench.gcs.heard} == {"HEARTBEAT", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"}

    def test_reports_missed_in_a_freeze_are_not_made_up_for(self, bench):
        bench.now_s = 100.0
        bench.autopilot.advance(bench.now_s)
        bench.deliver()
        assert len(bench.gcs.all("GLOBAL_POSITION_INT")) == 1

    def test_positions_agree_and_carry_simulated_time(self, airborne, velocity):
        airborne.run(20, repeat=velocity(3, 4, -1))
        place, local = airborne.gcs.last("GLOBAL_POSITION_INT"), airborne.gcs.last("LOCAL_POSITION_NED")
        north_m, east_m = airborne.autopilot.vehicle.frame.to_metres(place.lat / 1e7, place.lon / 1e7)
        assert place.time_boot_ms == local.time_boot_ms == round(airborne.now_s * 1000)
        assert (north_m, east_m) == pytest.approx((local.x, local.y), abs=0.02)
        assert place.relative_alt == pytest.approx(-local.z * 1000, abs=1)
        assert place.alt - place.relative_alt == 584_000
        assert (place.vx, place.vy, place.vz) == pytest.approx((300, 400, -100), abs=5)

    @pytest.mark.parametrize(
        "name",
        [
            "HEARTBEAT",
            "SYS_STATUS",
            "SYSTEM_TIME",
            "GPS_RAW_INT",
            "ATTITUDE",
            "LOCAL_POSITION_NED",
            "GLOBAL_POSITION_INT",
            "VFR_HUD",
            "POSITION_TARGET_LOCAL_NED",
            "BATTERY_STATUS",
            "AUTOPILOT_VERSION",
            "EKF_STATUS_REPORT",
            "HOME_POSITION",
            "GPS_GLOBAL_ORIGIN",
            "EXTENDED_SYS_STATE",
        ],
    )
    def test_a_message_may_be_asked_for_once(self, airborne, name):
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
        assert airborne.gcs.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number) == ACCEPTED
        assert len(airborne.gcs.all(name)) == 1

    def test_asking_for_an_unknown_message_fails(self, bench):
        assert bench.gcs.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 9999) == FAILED

    def test_each_vehicle_has_an_id_of_its_own(self, bench):
        bench.gcs.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)
        version = bench.gcs.last("AUTOPILOT_VERSION")
        assert version.uid == bench.autopilot.vehicle.uid != 0

    def test_flying_uses_the_battery(self, airborne):
        airborne.run(300)
        assert 50 < airborne.gcs.last("SYS_STATUS").battery_remaining < 90


class TestProtocols:
    def test_an_unknown_command_is_unsupported(self, bench):
        assert bench.gcs.command(31000) == UNSUPPORTED

    def test_a_command_to_another_system_is_ignored(self, bench):
        assert bench.gcs.command(ARM, 1, target=4) is None
        assert not bench.flight.armed

    def test_an_acknowledgement_names_the_station_that_asked(self, bench):
        bench.gcs.command(ARM, 1)
        ack = bench.gcs.last("COMMAND_ACK")
        assert (ack.target_system, ack.target_component) == (255, 190)

    def test_every_parameter_is_listed(self, bench):
        bench.gcs.send(mavlink.MAVLink_param_request_list_message(3, 1))
        values = bench.gcs.all("PARAM_VALUE")
        assert [value.param_index for value in values] == list(range(values[0].param_count))
        assert {"GUID_TIMEOUT", "SYSID_MYGCS", "WPNAV_ACCEL"} <= {value.param_id for value in values}

    def test_a_parameter_is_read_by_name_or_index(self, bench):
        bench.gcs.send(mavlink.MAVLink_param_request_read_message(3, 1, b"GUID_TIMEOUT", -1))
        by_name = bench.gcs.last("PARAM_VALUE")
        bench.gcs.send(mavlink.MAVLink_param_request_read_message(3, 1, b"", by_name.param_index))
        assert by_name.param_value == bench.gcs.last("PARAM_VALUE").param_value == 3.0

    def test_a_parameter_set_in_flight_takes_effect(self, airborne, velocity):
        airborne.gcs.send(mavlink.MAVLink_param_set_message(3, 1, b"WPNAV_SPEED", 200, 9))
        assert airborne.gcs.last("PARAM_VALUE").param_value == 200
        assert speed_after(airborne, velocity(5))[0] == pytest.approx(2.06, abs=0.05)

    def test_a_parameter_is_kept_in_its_range_and_nonsense_ignored(self, bench):
        bench.gcs.send(mavlink.MAVLink_param_set_message(3, 1, b"GUID_TIMEOUT", 60, 9))
        assert bench.gcs.last("PARAM_VALUE").param_value == 5
        bench.gcs.heard.clear()
        bench.gcs.send(mavlink.MAVLink_param_set_message(3, 1, b"GUID_TIMEOUT", nan, 9))
        bench.gcs.send(mavlink.MAVLink_param_set_message(3, 1, b"NO_SUCH", 1, 9))
        assert bench.gcs.heard == []

    def test_there_is_no_mission_and_none_may_be_uploaded(self, bench):
        bench.gcs.send(mavlink.MAVLink_mission_request_list_message(3, 1))
        assert bench.gcs.last("MISSION_COUNT").count == 0
        bench.gcs.send(mavlink.MAVLink_mission_count_message(3, 1, 5))
        assert bench.gcs.last("MISSION_ACK").type != mavlink.MAV_MISSION_ACCEPTED

    def test_timesync_is_answered_with_simulated_time(self, bench):
        bench.run(2)
        bench.gcs.send(mavlink.MAVLink_timesync_message(0, 1234))
        answer = bench.gcs.last("TIMESYNC")
        assert (answer.tc1, answer.ts1) == (2_000_000_000, 1234)
