"""What PX4's parameters mean: each check against the values it is there for."""

import pytest

from drivers.mavlink.autopilots.px4 import LONGEST_GAP_S
from drivers.mavlink.autopilots.px4_parameters import (
    PARAMETER_CHECKS,
    SHORTEST_TIMEOUT_S,
    failsafe_return_altitude_m,
)
from drivers.mavlink.checks import Intent, Verdict

INTENT = Intent(altitude_m=20.0, speed_mps=4.4, reach_m=80.0, station_system_id=255)
PASSED, SOFT, HARD = Verdict.PASSED, Verdict.SOFT, Verdict.HARD
SWARM = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 5.0, "NAV_DLL_ACT": 3.0, "COM_RCL_EXCEPT": 4.0, "GF_ACTION": 2.0}
OUT_OF_THE_BOX = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0.0, "NAV_DLL_ACT": 0.0, "COM_RCL_EXCEPT": 0.0}


def finding(name, **parameters):
    (check,) = (check for check in PARAMETER_CHECKS if check.name == name)
    assert parameters.keys() <= set(check.reads), "a parameter that would not be read"
    return check.judge(parameters, INTENT)


@pytest.mark.parametrize("check", PARAMETER_CHECKS, ids=lambda check: check.name)
def test_the_parameters_of_the_swarm_pass_and_none_at_all_are_soft(check):
    assert check.judge(SWARM, INTENT).verdict is PASSED
    nothing = check.judge({}, INTENT)
    assert nothing.verdict is SOFT
    assert nothing.way_out


def test_an_autopilot_out_of_the_box_may_fly_and_is_complained_about():
    verdicts = [check.judge({**OUT_OF_THE_BOX, "GF_ACTION": 2.0}, INTENT).verdict for check in PARAMETER_CHECKS]
    assert verdicts == [PASSED, SOFT, SOFT, SOFT, PASSED]


@pytest.mark.parametrize(("timeout_s", "least_m", "most_m"), [(1.0, 10.0, 12.0), (0.95, 9.2, 12.0)])
def test_the_distance_flown_without_setpoints_is_what_was_measured(timeout_s, least_m, most_m):
    found = finding("setpoint time-out", COM_OF_LOSS_T=timeout_s).found
    assert least_m <= float(found.split("comes to rest ")[1].split()[0]) <= most_m


def test_offboard_must_not_end_before_the_service_knows():
    assert finding("setpoint time-out", COM_OF_LOSS_T=0.5).verdict is HARD
    assert SHORTEST_TIMEOUT_S > LONGEST_GAP_S
    assert finding("setpoint time-out", COM_OF_LOSS_T=5.0).verdict is SOFT


@pytest.mark.parametrize(("action", "verdict"), [(0, SOFT), (3, SOFT), (4, SOFT), (5, PASSED), (6, HARD), (7, HARD)])
def test_what_follows_offboard(action, verdict):
    assert finding("after OFFBOARD", COM_OBL_RC_ACT=float(action)).verdict is verdict


@pytest.mark.parametrize(
    ("action", "verdict"), [(0, SOFT), (1, PASSED), (2, PASSED), (3, PASSED), (5, HARD), (6, HARD)]
)
def test_what_follows_the_loss_of_the_station(action, verdict):
    assert finding("station failsafe", NAV_DLL_ACT=float(action)).verdict is verdict


@pytest.mark.parametrize(("exceptions", "verdict"), [(0, SOFT), (3, SOFT), (4, PASSED), (7, PASSED)])
def test_a_remote_control_may_be_missing_in_offboard(exceptions, verdict):
    assert finding("remote control", COM_RCL_EXCEPT=float(exceptions)).verdict is verdict


@pytest.mark.parametrize(
    ("parameters", "verdict"),
    [
        ({"GF_ACTION": 2.0, "GF_MAX_VER_DIST": 0.0, "GF_MAX_HOR_DIST": 0.0}, PASSED),
        ({"GF_ACTION": 2.0, "GF_MAX_VER_DIST": 19.0, "GF_MAX_HOR_DIST": 0.0}, HARD),
        ({"GF_ACTION": 0.0, "GF_MAX_VER_DIST": 19.0, "GF_MAX_HOR_DIST": 0.0}, PASSED),
        ({"GF_ACTION": 3.0, "GF_MAX_VER_DIST": 50.0, "GF_MAX_HOR_DIST": 79.0}, HARD),
        ({"GF_ACTION": 3.0, "GF_MAX_VER_DIST": 50.0, "GF_MAX_HOR_DIST": 100.0}, PASSED),
    ],
)
def test_the_route_has_to_lie_inside_the_fence(parameters, verdict):
    assert finding("geofence", **parameters).verdict is verdict


@pytest.mark.parametrize(
    ("parameters", "altitude_m"),
    [
        ({"NAV_DLL_ACT": 2.0, "COM_OBL_RC_ACT": 5.0, "RTL_RETURN_ALT": 30.0}, 30.0),
        ({"NAV_DLL_ACT": 3.0, "COM_OBL_RC_ACT": 0.0, "RTL_RETURN_ALT": 30.0}, 30.0),
        ({"NAV_DLL_ACT": 3.0, "COM_OBL_RC_ACT": 5.0, "RTL_RETURN_ALT": 30.0}, None),
        ({}, None),
    ],
)
def test_only_a_failsafe_that_returns_has_a_return_altitude(parameters, altitude_m):
    assert failsafe_return_altitude_m(parameters) == altitude_m
