"""The simulated ArduCopter before a flight: its own checks, who it is, and a reboot."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ACCEPTED, REJECTED, FAILED = 0, 1, 4
GUIDED, STABILIZE = 4, 0
ARM, REBOOT = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
RUN_PREARM_CHECKS = mavlink.MAV_CMD_RUN_PREARM_CHECKS
POSITION = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
FORCED = (1, 0, 0, 0, 0, 20190226)


def test_its_checks_complain_until_it_is_ready_and_never_arm(make_bench):
    bench = make_bench(ready_s=5.0)
    assert bench.gcs.command(RUN_PREARM_CHECKS) == ACCEPTED
    assert bench.gcs.texts() == ["PreArm: Need Position Estimate"]
    bench.run(6)
    assert bench.gcs.command(RUN_PREARM_CHECKS) == ACCEPTED
    assert bench.gcs.texts() == []
    assert not bench.flight.armed


def test_its_checks_are_not_run_when_armed(bench):
    bench.gcs.command(ARM, 1)
    assert bench.gcs.command(RUN_PREARM_CHECKS) == REJECTED


class TestReboot:
    def heard_after(self, bench, duration_s):
        bench.gcs.heard.clear()
        bench.run(duration_s)
        return {message.get_type() for message in bench.gcs.heard}

    def test_the_heartbeat_is_gone_for_more_than_a_second_and_the_clock_restarts(self, bench):
        bench.run(30)
        assert bench.gcs.command(REBOOT, 1) == ACCEPTED
        assert self.heard_after(bench, 1.5) & {"HEARTBEAT"} == set()
        assert "HEARTBEAT" in self.heard_after(bench, 0.2)
        assert bench.gcs.last("GLOBAL_POSITION_INT").time_boot_ms < 1200

    def test_the_mode_and_the_rates_asked_for_are_lost_and_the_parameters_kept(self, make_bench):
        bench = make_bench(SR0_POSITION=0)
        bench.mode(GUIDED)
        bench.gcs.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, POSITION, 100_000)
        bench.gcs.send(mavlink.MAVLink_param_set_message(3, 1, b"GUID_TIMEOUT", 1.0, 9))
        assert "GLOBAL_POSITION_INT" in self.heard_after(bench, 3)
        bench.gcs.command(REBOOT, 1)
        heard = self.heard_after(bench, 10)
        assert "HEARTBEAT" in heard
        assert "GLOBAL_POSITION_INT" not in heard
        assert bench.gcs.last("HEARTBEAT").custom_mode == STABILIZE
        assert bench.autopilot.flight.parameters["GUID_TIMEOUT"] == 1.0

    def test_it_hears_nothing_while_it_boots(self, bench):
        bench.gcs.command(REBOOT, 1)
        bench.run(0.3)
        assert bench.mode(GUIDED) is None
        bench.run(1.0)
        assert bench.mode(GUIDED) == ACCEPTED

    def test_it_boots_again_and_again(self, bench):
        for _ in range(3):
            bench.run(5)
            assert bench.gcs.command(REBOOT, 1) == ACCEPTED
            bench.run(3)
            assert bench.gcs.last("GLOBAL_POSITION_INT").time_boot_ms == pytest.approx(2400, abs=300)

    def test_armed_it_is_refused_unless_forced_and_then_it_lies_on_the_ground_below(self, airborne, velocity):
        airborne.run(10, repeat=velocity(3))
        north_m = airborne.sample().north_m
        assert airborne.gcs.command(REBOOT, 1) == FAILED
        assert airborne.gcs.command(REBOOT, *FORCED) == ACCEPTED
        airborne.run(5)
        assert not airborne.autopilot.flight.armed
        position = airborne.gcs.last("GLOBAL_POSITION_INT")
        frame = airborne.autopilot.vehicle.frame
        assert frame.to_metres(position.lat / 1e7, position.lon / 1e7)[0] == pytest.approx(north_m, abs=1.0)
        assert position.relative_alt == 0

    def test_it_can_fly_again(self, bench):
        bench.gcs.command(REBOOT, 1)
        bench.run(3)
        bench.mode(GUIDED)
        assert bench.gcs.command(ARM, 1) == ACCEPTED
        assert bench.gcs.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == ACCEPTED
        bench.run(20)
        assert bench.gcs.last("GLOBAL_POSITION_INT").relative_alt == pytest.approx(10_000, abs=300)

    def test_other_kinds_of_shutdown_are_not_supported(self, bench):
        assert bench.gcs.command(REBOOT, 2) == 3
