"""The whole preflight against simulated ArduCopters: what it finds, that it waits, and that it never arms."""

import asyncio
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.checks import Verdict
from gcs.playbook.schema import Playbook
from gcs.preflight.report import PreflightError
from gcs.preflight.run import preflight
from planner.frames import SiteFrame
from tests.drivers.mavlink.benched import Bench
from tests.fakes import ManualClock

PASSED, SOFT, HARD, RUNNING = Verdict.PASSED, Verdict.SOFT, Verdict.HARD, Verdict.RUNNING
PLAYBOOK = Playbook.model_validate(
    {
        "playbook": 1,
        "name": "bench",
        "formation": {"kind": "custom", "slots": {"O1": [70, 60]}},
        "transmitters": {"L0": {"at": [0, 0]}, "L1": {"at": [100, 0]}},
        "receivers": {"U1": {"start": [20, 30]}},
        "flight": {"altitude_m": 20.0},
    }
)
HARMLESS = {
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
    mavlink.MAV_CMD_REQUEST_MESSAGE,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS,
}


def home(name, playbook=PLAYBOOK):
    frame = playbook.site.frame
    return SiteFrame(playbook.site.origin).to_geodetic(frame.to_site(playbook.uavs[name]))


class Preflight:
    """A bench of the playbook's vehicles; keyword arguments by a vehicle's name change its copter."""

    def __init__(self, playbook=PLAYBOOK):
        self.bench = Bench(ManualClock())
        self.playbook = playbook
        self.shown = []

    def add_all(self, **changed):
        for name in self.playbook.uavs:
            self.bench.add(name, **{"home": home(name, self.playbook), **changed.get(name, {})})
        return self

    async def run(self):
        vehicles = self.bench.vehicles
        task = asyncio.create_task(preflight(vehicles, self.playbook, self.playbook.plan(), self.shown.append))
        report = await self.bench.until_done(task)
        for name, vehicle in vehicles.items():
            assert set(vehicle.link.commands) <= HARMLESS, f"{name} was told to do something"
            assert not any(vehicle.link.autopilot.flight.armed for vehicle in vehicles.values())
        return report


def verdicts(report, verdict):
    return {(check.vehicle, check.name): check.found for check in report.having(verdict)}


async def test_vehicles_as_they_should_be_pass_every_check():
    report = await Preflight().add_all().run()
    assert verdicts(report, SOFT) == verdicts(report, HARD) == {}
    assert report.may_arm
    report.require()
    assert set(report.autopilots) == {"L0", "L1", "U1"}
    of_one = [check.name for check in report.checks if check.vehicle == "U1"]
    assert of_one == [
        *("autopilot", "system id", "telemetry", "estimator", "pre-arm", "battery", "clock", "altitude", "start"),
        *("setpoint time-out", "station failsafe", "geofence", "heading"),
    ]
    assert [check.name for check in report.checks if check.vehicle == "fleet"] == [
        *("identity", "home level", "apart", "return altitude"),
    ]


async def test_it_runs_until_the_last_vehicle_knows_its_position():
    field = Preflight().add_all(L1={"ready_s": 41.7})
    started_s = field.bench.clock.now_s()
    report = await field.run()
    assert report.may_arm
    assert 41.7 < field.bench.clock.now_s() - started_s < 60.0
    running = [check.name for check in field.shown if (check.vehicle, check.verdict) == ("L1", RUNNING)]
    assert running == ["heartbeat", "autopilot", "estimator", "pre-arm"]
    assert RUNNING not in {check.verdict for check in report.checks}


async def test_a_vehicle_that_never_knows_its_position_is_a_hard_failure_with_its_own_words():
    report = await Preflight().add_all(U1={"ready_s": 1e6}).run()
    hard = verdicts(report, HARD)
    assert hard.keys() == {("U1", "estimator"), ("U1", "pre-arm")}
    assert "no position estimate within 90 s" in hard["U1", "estimator"]
    assert hard["U1", "pre-arm"] == "PreArm: Need Position Estimate"
    assert not report.may_arm


async def test_a_vehicle_that_is_not_there_is_a_hard_failure_and_the_others_are_checked():
    field = Preflight().add_all()
    field.bench.vehicles["U1"].link.garble = lambda _message: None
    field.bench.vehicles["U1"].link.heard_system_ids = frozenset({7, 5})
    report = await field.run()
    assert verdicts(report, HARD) == {("U1", "heartbeat"): "no heartbeat of system id 3 within 30 s, but of 5, 7"}
    assert set(report.autopilots) == {"L0", "L1"}
    assert ("L1", "estimator") in verdicts(report, PASSED)


async def test_a_vehicle_that_falls_silent_is_not_waited_for_any_longer():
    field = Preflight().add_all(U1={"ready_s": 1e6})
    clock, began_s = field.bench.clock, field.bench.clock.now_s()
    field.bench.vehicles["U1"].link.garble = lambda message: message if clock.now_s() < began_s + 5.0 else None
    report = await field.run()
    assert verdicts(report, HARD) == {("U1", "estimator"): "it fell silent: nothing was heard of it for 10 s"}
    assert clock.now_s() - began_s < 20.0


async def test_a_rover_is_refused():
    field = Preflight().add_all()

    def as_rover(message):
        if message.get_type() == "HEARTBEAT":
            message.type = mavlink.MAV_TYPE_GROUND_ROVER
        return message

    field.bench.vehicles["U1"].link.garble = as_rover
    hard = verdicts(await field.run(), HARD)
    assert hard.keys() == {("U1", "autopilot")}
    assert "a rover with ArduPilot" in hard["U1", "autopilot"]


async def test_every_hard_failure_is_named_when_passing_is_required():
    report = (
        await Preflight()
        .add_all(L0={"FENCE_ENABLE": 1, "FENCE_ALT_MAX": 10}, U1={"SYSID_ENFORCE": 1, "SYSID_MYGCS": 7})
        .run()
    )
    with pytest.raises(PreflightError, match="nothing was armed") as caught:
        report.require()
    assert {(check.vehicle, check.name) for check in caught.value.failures} == {
        ("L0", "geofence"),
        ("U1", "station failsafe"),
    }
    assert "L0 on udpin:127.0.0.1:14550: geofence: FENCE_ALT_MAX 10" in str(caught.value)


async def test_what_is_found_of_several_vehicles_is_one_line():
    turning = {"WP_YAW_BEHAVIOR": 2}
    report = await Preflight().add_all(L0=turning, U1=turning, L1={"GUID_TIMEOUT": 3}).run()
    lines = report.lines(SOFT)
    assert [line.split(": ")[0] for line in lines] == ["L0, U1", "L1 on udpin:127.0.0.1:14550"]
    assert lines[0] == (
        "L0, U1: heading: WP_YAW_BEHAVIOR 2 turns its nose where no setpoint holds it. "
        "For antenna arrays: WP_YAW_BEHAVIOR 0 and GUID_OPTIONS 4."
    )


async def test_the_same_autopilot_under_two_names_is_a_hard_failure():
    report = await Preflight().add_all(L1={"called": "one", "home": home("L0")}, L0={"called": "one"}).run()
    hard = verdicts(report, HARD)
    assert hard["L1", "identity"] == "is the same autopilot as L0"
    assert ("L1", "apart") in hard


async def test_a_vehicle_far_from_its_start_is_a_hard_failure():
    report = await Preflight().add_all(U1={"home": home("L1")}, L1={"home": home("U1")}).run()
    assert verdicts(report, HARD).keys() == {("U1", "start"), ("L1", "start")}


async def test_homes_at_different_levels_are_told():
    high = replace(home("U1"), altitude_m=home("U1").altitude_m + 5.0)
    report = await Preflight().add_all(U1={"home": high}).run()
    assert "5.0 m above" in verdicts(report, SOFT)["U1", "home level"]


async def test_all_that_would_fly_home_at_one_altitude_are_told():
    homeward = {"FS_GCS_ENABLE": 1}
    report = await Preflight().add_all(L0=homeward, L1=homeward, U1={**homeward, "RTL_ALT": 2500}).run()
    assert verdicts(report, SOFT).keys() == {("L1", "return altitude")}


async def test_messages_lost_now_and_then_do_no_harm():
    field = Preflight().add_all()
    count = iter(range(10**6))
    for vehicle in field.bench.vehicles.values():
        vehicle.link.garble = lambda message: None if next(count) % 5 == 0 else message
    report = await field.run()
    assert verdicts(report, HARD) == {}


async def test_an_armed_vehicle_on_the_ground_is_told_and_its_checks_are_not_run():
    field = Preflight().add_all()
    u1 = field.bench.vehicles["U1"]
    await field.bench.pass_time(1.0)
    u1.link.autopilot.flight.arm()
    u1.link.autopilot.flight.parameters.set("DISARM_DELAY", 0)
    await field.bench.pass_time(1.5)
    task = asyncio.create_task(preflight(field.bench.vehicles, PLAYBOOK, PLAYBOOK.plan()))
    soft = verdicts(await field.bench.until_done(task), SOFT)
    assert soft.keys() == {("U1", "pre-arm"), ("U1", "altitude")}
    assert mavlink.MAV_CMD_RUN_PREARM_CHECKS not in u1.link.commands
