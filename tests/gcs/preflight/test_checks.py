"""Each check of one vehicle and of the fleet, at the seams between its verdicts."""

from dataclasses import replace

import pytest

from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.checks import Intent, Verdict
from drivers.mavlink.identity import Identity
from drivers.mavlink.timesync import ClockOffset
from drivers.mavlink.vehicle import Battery
from gcs.preflight.expected import Expected
from gcs.preflight.facts import PreArm, VehicleFacts
from gcs.preflight.fleet_checks import FLEET_CHECKS, check_fleet
from gcs.preflight.vehicle_checks import VEHICLE_CHECKS, check_vehicle
from planner.frames import GeodeticPosition, SiteFrame

PASSED, SOFT, HARD = Verdict.PASSED, Verdict.SOFT, Verdict.HARD
EXPECTED = Expected(
    intent=Intent(altitude_m=20.0, speed_mps=5.0, reach_m=80.0, station_system_id=255),
    autopilot=None,
    start=30 + 40j,
    start_sigma_m=1.0,
    min_separation_m=5.0,
    site=SiteFrame(GeodeticPosition(47.0, 8.0, 400.0)),
)
READY = VehicleFacts(
    name="U1",
    expected=EXPECTED,
    autopilot=ArduCopter(),
    identities=frozenset({Identity("0a", "4.6.3")}),
    contested=False,
    missing_messages=(),
    not_ready="",
    armed=False,
    pre_arm=PreArm((), healthy=True),
    battery=Battery(90, 12.4),
    clock=ClockOffset(0, 0.02),
    parameters={},
    height_m=0.1,
    home_altitude_m=584.0,
    place=30 + 40j,
)


def verdict(name, **changed):
    (check,) = (check for check in VEHICLE_CHECKS if check.name == name)
    finding = check.judge(replace(READY, **changed))
    assert (finding.verdict is PASSED) == (finding.way_out == ""), "what is not as it should be has a way out"
    return finding.verdict


def test_a_vehicle_as_it_should_be_passes_them_all():
    checks = list(check_vehicle(READY))[: len(VEHICLE_CHECKS)]
    assert {check.verdict for check in checks} == {PASSED}
    assert {check.vehicle for check in checks} == {"U1"}


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"identities": frozenset({Identity("0a", "4.6.3"), Identity("0b", "4.6.3")})}, HARD),
        ({"contested": True}, HARD),
        ({"identities": frozenset({Identity("", "4.6.3")})}, SOFT),
        ({"identities": frozenset()}, SOFT),
    ],
)
def test_one_autopilot_has_to_answer(changed, expected):
    assert verdict("system id", **changed) is expected


@pytest.mark.parametrize(
    ("pre_arm", "armed", "expected"),
    [
        (PreArm(("PreArm: Compass not healthy",), healthy=False), False, HARD),
        (PreArm(("PreArm: Compass not healthy",), healthy=True), False, HARD),
        (PreArm((), healthy=False), False, HARD),
        (PreArm((), healthy=False, not_run="refused"), False, HARD),
        (PreArm((), healthy=True, not_run="refused"), False, SOFT),
        (None, True, SOFT),
    ],
)
def test_its_own_checks_decide(pre_arm, armed, expected):
    assert verdict("pre-arm", pre_arm=pre_arm, armed=armed) is expected


@pytest.mark.parametrize(
    ("battery", "expected"),
    [
        (None, SOFT),
        (Battery(None, 12.0), SOFT),
        (Battery(19, None), HARD),
        (Battery(20, None), SOFT),
        (Battery(39, None), SOFT),
        (Battery(40, None), PASSED),
    ],
)
def test_the_battery(battery, expected):
    assert verdict("battery", battery=battery) is expected


@pytest.mark.parametrize(("round_trip_s", "expected"), [(0.5, PASSED), (0.51, SOFT), (4.0, SOFT)])
def test_a_slow_link_is_told(round_trip_s, expected):
    assert verdict("clock", clock=ClockOffset(0, round_trip_s)) is expected


def test_a_clock_nobody_knows_and_messages_that_do_not_come_are_told():
    assert verdict("clock", clock=None) is SOFT
    assert verdict("telemetry", missing_messages=("SYS_STATUS",)) is SOFT


def test_no_vehicle_arms_without_a_position_estimate():
    assert verdict("estimator", not_ready="no position estimate within 90 s") is HARD


@pytest.mark.parametrize(
    ("height_m", "armed", "expected"),
    [
        (0.0, False, PASSED),
        (-2.9, False, PASSED),
        (0.5, True, SOFT),
        (8.0, False, SOFT),
        (19.1, True, SOFT),
        (20.9, True, SOFT),
        (18.9, True, HARD),
        (21.1, True, HARD),
        (8.0, True, HARD),
        (None, False, SOFT),
    ],
)
def test_it_stands_on_the_ground_or_flies_at_the_altitude(height_m, armed, expected):
    assert verdict("altitude", height_m=height_m, armed=armed) is expected


@pytest.mark.parametrize(
    ("apart_m", "sigma_m", "expected"),
    [
        (2.9, 1.0, PASSED),
        (3.1, 1.0, SOFT),
        (19.9, 1.0, SOFT),
        (20.1, 1.0, HARD),
        (14.9, 5.0, PASSED),
        (49.0, 5.0, SOFT),
        (51.0, 5.0, HARD),
    ],
)
def test_it_stands_at_its_start_as_well_as_that_is_known(apart_m, sigma_m, expected):
    at_start = replace(EXPECTED, start_sigma_m=sigma_m)
    assert verdict("start", expected=at_start, place=EXPECTED.start + apart_m * 1j) is expected


def test_a_place_nobody_knows_is_told():
    assert verdict("start", place=None) is SOFT


def wrong(name, *fleet):
    """Return the verdicts of one fleet check that are not for all."""
    assert any(check.name == name for check in FLEET_CHECKS)
    return {
        check.vehicle: check.verdict
        for check in check_fleet(fleet)
        if check.name == name and check.verdict is not PASSED
    }


def fleet_of(*changes):
    """Return vehicles V0, V1, ... that are as they should be but for the changes."""
    return [
        replace(
            READY,
            **{"name": f"V{n}", "identities": frozenset({Identity(f"{n:02x}", "1")}), "place": 50j * n, **changed},
        )
        for n, changed in enumerate(changes)
    ]


def test_a_fleet_as_it_should_be_passes_once_for_all():
    checks = list(check_fleet(fleet_of({}, {}, {})))
    assert [(check.vehicle, check.verdict) for check in checks] == [("fleet", PASSED)] * len(FLEET_CHECKS)


def test_nobody_at_all_fails_nothing():
    assert {check.verdict for check in check_fleet([])} == {PASSED}


def test_one_autopilot_is_one_vehicle():
    same = {"identities": frozenset({Identity("0a", "4.6.3")})}
    assert wrong("identity", *fleet_of({}, same, same)) == {"V2": HARD}


def test_autopilots_without_a_number_are_not_taken_for_the_same():
    unknown = {"identities": frozenset({Identity("", "4.6.3")})}
    assert wrong("identity", *fleet_of(unknown, unknown)) == {}


def test_homes_are_compared_with_the_middle_one():
    heights = [{"home_altitude_m": m} for m in (584.0, 585.0, 588.5, 600.0, 584.5)]
    assert wrong("home level", *fleet_of(*heights, {"home_altitude_m": None})) == {"V2": SOFT, "V3": HARD}


@pytest.mark.parametrize(
    ("apart_m", "expected"), [(5.1, {}), (4.9, {"V1": SOFT}), (2.4, {"V1": HARD}), (0.0, {"V1": HARD})]
)
def test_vehicles_stand_apart(apart_m, expected):
    assert wrong("apart", *fleet_of({"place": 0j}, {"place": complex(apart_m)}, {"place": None})) == expected


def test_each_that_returns_at_anothers_altitude_is_told_once():
    home = [{"parameters": {"FS_GCS_ENABLE": 1.0, "RTL_ALT": cm}} for cm in (1500.0, 1500.0, 1600.0, 2500.0)]
    assert wrong("return altitude", *fleet_of(*home)) == {"V1": SOFT, "V2": SOFT}
