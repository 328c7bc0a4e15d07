"""What ArduCopter's parameters mean: each check against the values it is there for."""

import pytest

from drivers.mavlink.autopilots.ardupilot_parameters import PARAMETER_CHECKS, failsafe_return_altitude_m
from drivers.mavlink.checks import Intent, Verdict

INTENT = Intent(altitude_m=20.0, speed_mps=5.0, reach_m=80.0, station_system_id=255)
PASSED, SOFT, HARD = Verdict.PASSED, Verdict.SOFT, Verdict.HARD
SWARM = {
    "GUID_TIMEOUT": 1.0,
    "WPNAV_ACCEL": 250.0,
    "FS_GCS_ENABLE": 5.0,
    "SYSID_MYGCS": 255.0,
    "SYSID_ENFORCE": 0.0,
    "FENCE_ENABLE": 0.0,
    "WP_YAW_BEHAVIOR": 0.0,
    "GUID_OPTIONS": 4.0,
}
FENCED = {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 3.0, "FENCE_ALT_MAX": 100.0, "FENCE_RADIUS": 300.0, "FENCE_MARGIN": 2.0}


def finding(name, parameters, intent=INTENT):
    (check,) = (check for check in PARAMETER_CHECKS if check.name == name)
    assert parameters.keys() <= {*check.reads, *SWARM}, "a parameter that would not be read"
    return check.judge(parameters, intent)


@pytest.mark.parametrize("check", PARAMETER_CHECKS, ids=lambda check: check.name)
def test_the_parameters_of_the_swarm_pass_and_none_at_all_are_soft(check):
    assert check.judge(SWARM, INTENT).verdict is PASSED
    nothing = check.judge({}, INTENT)
    assert nothing.verdict is SOFT
    assert nothing.way_out


@pytest.mark.parametrize(
    ("timeout_s", "speed_mps", "further_m", "verdict"),
    [(3.0, 5.0, 22, SOFT), (1.0, 5.0, 12, PASSED), (2.0, 3.0, 9, PASSED)],
)
def test_the_distance_flown_without_setpoints_is_what_was_measured(timeout_s, speed_mps, further_m, verdict):
    intent = Intent(20.0, speed_mps, 80.0, 255)
    found = finding("setpoint time-out", {"GUID_TIMEOUT": timeout_s, "WPNAV_ACCEL": 250.0}, intent)
    assert f"{further_m} m further on at {speed_mps:g} m/s" in found.found
    assert found.verdict is verdict


@pytest.mark.parametrize(
    ("parameters", "verdict", "words"),
    [
        ({"FS_GCS_ENABLE": 0.0, "SYSID_MYGCS": 255.0}, SOFT, "hovers until its battery is empty"),
        ({"FS_GCS_ENABLE": 5.0, "SYSID_MYGCS": 254.0}, SOFT, "waits for system id 254"),
        ({"FS_GCS_ENABLE": 0.0, "SYSID_MYGCS": 254.0}, SOFT, "hovers"),
        ({"FS_GCS_ENABLE": 5.0, "SYSID_MYGCS": 254.0, "SYSID_ENFORCE": 1.0}, HARD, "obeys system id 254 only"),
        ({"FS_GCS_ENABLE": 5.0, "SYSID_MYGCS": 255.0, "SYSID_ENFORCE": 1.0}, PASSED, "system id 255"),
        ({"FS_GCS_ENABLE": 5.0, "MAV_GCS_SYSID": 255.0, "MAV_GCS_SYSID_HI": 0.0}, PASSED, "system id 255"),
        ({"FS_GCS_ENABLE": 5.0, "MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 255.0}, PASSED, "250 to 255"),
        ({"FS_GCS_ENABLE": 5.0, "MAV_GCS_SYSID": 245.0, "MAV_GCS_SYSID_HI": 250.0}, SOFT, "245 to 250"),
        ({"FS_GCS_ENABLE": 5.0, "MAV_GCS_SYSID": 1.0, "MAV_OPTIONS": 1.0}, HARD, "obeys system id 1 only"),
        ({"FS_GCS_ENABLE": 5.0, "MAV_GCS_SYSID": 1.0, "MAV_OPTIONS": 2.0}, SOFT, "waits for system id 1,"),
    ],
)
def test_the_failsafe_has_to_be_this_services(parameters, verdict, words):
    found = finding("station failsafe", parameters)
    assert found.verdict is verdict
    assert words in found.found


def test_the_way_out_names_the_parameter_of_the_release():
    new = finding("station failsafe", {"FS_GCS_ENABLE": 5.0, "MAV_GCS_SYSID": 1.0})
    assert "MAV_GCS_SYSID to 255" in new.way_out
    assert "SYSID_MYGCS" in finding("station failsafe", {"FS_GCS_ENABLE": 5.0, "SYSID_MYGCS": 1.0}).way_out


@pytest.mark.parametrize(
    ("changed", "verdict", "words"),
    [
        ({}, PASSED, "inside its fence"),
        ({"FENCE_ENABLE": 0.0, "FENCE_ALT_MAX": 10.0}, PASSED, "no fence"),
        ({"FENCE_ENABLE": 0.0, "FENCE_AUTOENABLE": 3.0, "FENCE_ALT_MAX": 10.0}, HARD, "it is to fly at 20 m"),
        ({"FENCE_ALT_MAX": 21.9}, HARD, "FENCE_ALT_MAX 21.9 with a margin of 2 m: it is to fly at 20 m"),
        ({"FENCE_ALT_MAX": 22.1}, PASSED, "inside"),
        ({"FENCE_ALT_MAX": 10.0, "FENCE_TYPE": 2.0}, PASSED, "inside"),
        ({"FENCE_RADIUS": 81.0}, HARD, "its route leads 80 m from home"),
        ({"FENCE_RADIUS": 81.0, "FENCE_TYPE": 1.0}, PASSED, "inside"),
        ({"FENCE_ALT_MIN": 25.0, "FENCE_TYPE": 8.0}, HARD, "FENCE_ALT_MIN 25"),
        ({"FENCE_TYPE": 7.0}, SOFT, "polygons"),
        ({"FENCE_TYPE": 7.0, "FENCE_ALT_MAX": 10.0}, HARD, "it is to fly at 20 m"),
    ],
)
def test_the_route_has_to_lie_inside_the_fence(changed, verdict, words):
    found = finding("geofence", {**FENCED, **changed})
    assert found.verdict is verdict
    assert words in found.found


@pytest.mark.parametrize(
    ("behaviour", "options", "words"),
    [(2.0, 4.0, "WP_YAW_BEHAVIOR 2"), (0.0, 0.0, "yaw stick"), (1.0, 3.0, "; GUID_OPTIONS")],
)
def test_what_may_turn_the_nose_is_said(behaviour, options, words):
    found = finding("heading", {"WP_YAW_BEHAVIOR": behaviour, "GUID_OPTIONS": options})
    assert found.verdict is SOFT
    assert words in found.found


@pytest.mark.parametrize(
    ("parameters", "altitude_m"),
    [
        ({"FS_GCS_ENABLE": 1.0, "RTL_ALT": 1500.0}, 15.0),
        ({"FS_GCS_ENABLE": 1.0, "RTL_ALT_M": 15.0}, 15.0),
        ({"FS_GCS_ENABLE": 5.0, "RTL_ALT": 1500.0}, None),
        ({"FS_GCS_ENABLE": 7.0, "RTL_ALT": 1500.0}, None),
        ({"FS_GCS_ENABLE": 0.0, "RTL_ALT": 1500.0}, None),
        ({"RTL_ALT": 1500.0}, None),
        ({"FS_GCS_ENABLE": 1.0}, None),
    ],
)
def test_only_a_failsafe_that_returns_has_a_return_altitude(parameters, altitude_m):
    assert failsafe_return_altitude_m(parameters) == altitude_m
