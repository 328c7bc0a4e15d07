"""The observer finds what must never happen: shown with executors and vehicles that do it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from gcs.faults.fault import Fault, Kind, Moment
from gcs.faults.observer import Observer, Rules, Sight
from gcs.faults.outcome import FaultRun, fly_faults, watch
from gcs.faults.world import FaultyWorld
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.relay.executor import Work
from gcs.relay.journey import Journey
from gcs.relay.leg_flight import LegFlight
from gcs.relay.states import ReceiverState
from gcs.relay.wary_filter import WaryFilter
from gcs.report_checks import ReportChecks
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from gcs.stop_monitor import StopMonitor
from tests.gcs.simulate.small import small, small_text

Change = Callable[[FaultyWorld], None]


@pytest.fixture
def playbook(tmp_path: Path) -> Playbook:
    return small(tmp_path)


@pytest.fixture
def two(tmp_path: Path) -> Playbook:
    return small(tmp_path, two=True)


@pytest.fixture
def three(tmp_path: Path) -> Playbook:
    """One receiver that hears three transmitters."""
    path = tmp_path / "three.yaml"
    path.write_text(small_text("planner: {method: joint}\n").replace("[100, 0]}", "[100, 0]}\n  L2: {at: [50, 120]}"))
    return load_playbook(path)


def fault(kind: Kind, state: str = "LEG_1", after_s: float = 1.0, target: str = "U1", **values) -> Fault:
    return Fault(kind, target, Moment("U1", state, after_s), values.pop("for_s", None), **values)


def fly(
    playbook: Playbook, *faults: Fault, work: Work | None = None, mutate: Change = lambda _: None, seed: int = 1
) -> FaultRun:
    """Fly a relay whose executor does `work` for each receiver, in a world that `mutate` has changed."""

    async def flown() -> FaultRun:
        plan = playbook.plan()
        world = FaultyWorld(playbook, plan, VirtualClock(), seed, faults)
        if work is not None:
            world.executor._bring_by = work
        mutate(world)
        return await watch(world, plan, seed, faults)

    return run_virtually(flown())


def found(run: FaultRun) -> set[str]:
    return {finding.invariant for finding in run.violations}


def blindly(velocity: complex, for_s: float, *, placed: bool = False) -> Work:
    """Return an executor's work that flies by the clock, whatever is heard, and perhaps says that it is PLACED then."""

    async def bring(journey: Journey) -> None:
        around, record = journey.around, journey.record
        around.enter(record, ReceiverState.LOCATING)
        around.emission.need(record.name, record.route.transmitters)
        await around.clock.sleep(1.0)
        around.enter(record, ReceiverState.LEG_1)
        began_s = around.clock.now_s()
        while around.clock.now_s() < began_s + for_s:
            journey.lease.renew(velocity)
            await around.clock.sleep(0.1)
        journey.lease.stop()
        await around.clock.sleep(3.0)
        around.enter(record, ReceiverState.VERIFYING)
        await around.clock.sleep(2.0)
        if placed:
            around.enter(record, ReceiverState.PLACED)

    return bring


def deaf_to_the_pilot(world: FaultyWorld) -> None:
    world.executor.look = lambda: None
    vehicle = world.vehicles["U1"]
    vehicle.take_over = lambda: setattr(vehicle, "piloted", True)


def without_objections(world: FaultyWorld) -> None:
    world.executor.objection = lambda _: None


def however_old(world: FaultyWorld) -> None:
    world.feed._max_age_s = float("inf")


def without_lease(world: FaultyWorld) -> None:
    for vehicle in world.vehicles.values():
        vehicle._limits = type(vehicle._limits)(lease_s=60.0)


@pytest.mark.parametrize(
    "struck",
    [
        fault("sensor_silent"),
        fault("sensor_stuck"),
        fault("sensor_jump", amount=0.785),
        fault("report_delay", amount=1.5),
        fault("telemetry_lost"),
        fault("link_cut"),
        fault("vehicle_frozen"),
        fault("bus_lost"),
        fault("pilot_receiver"),
        fault("transmitter_silent", target="L1"),
        fault("pilot_transmitter", target="L1"),
        fault("vehicle_reboot", for_s=3.0),
        fault("battery_low"),
        fault("service_stopped", for_s=5.0),
        fault("service_killed"),
        fault("link_loss", amount=0.5),
        fault("link_duplication", amount=1.0),
        fault("link_reordering", amount=0.5),
        fault("link_delay", amount=1.0),
        fault("link_jitter", amount=0.8),
        fault("report_reordering", amount=0.4),
        fault("report_duplication", amount=1.0),
        fault("report_loss", amount=0.5),
    ],
    ids=lambda struck: struck.kind,
)
def test_the_service_s_own_executor_keeps_to_everything(playbook: Playbook, struck: Fault) -> None:
    run = fly(playbook, struck)
    assert run.violations == []
    assert run.struck_s[0] is not None


def test_a_fault_that_passes_is_flown_on_from_and_one_that_stays_holds(playbook: Playbook) -> None:
    assert fly(playbook, fault("sensor_silent", for_s=1.0)).outcome == "formed"
    held = fly(playbook, fault("sensor_silent"))
    assert held.outcome == "held"
    assert "no bearing report" in held.reason


def test_a_seed_flies_the_same_again(playbook: Playbook) -> None:
    faults = (fault("report_loss", amount=0.3), fault("transmitter_drift", "LEG_2", target="L1", amount=0.3))
    assert fly(playbook, *faults, seed=5) == fly(playbook, *faults, seed=5)


def test_an_operator_who_resumes_after_a_pilot_gets_his_formation(playbook: Playbook) -> None:
    run = fly_faults(playbook, playbook.plan(), 1, (fault("pilot_receiver"),), attended=True)
    assert (run.outcome, run.violations) == ("formed", [])


def test_flying_on_without_bearings_is_found(playbook: Playbook) -> None:
    assert found(fly(playbook, work=blindly(0.7 + 0j, 20.0))) == set()
    run = fly(playbook, fault("sensor_silent"), work=blindly(0.7 + 0j, 20.0))
    assert found(run) == {"fresh_bearing", "stopped"}
    assert run.violations[0].time_s == pytest.approx(run.struck_s[0] + 0.5, abs=0.25)


@pytest.mark.parametrize("kind", ["telemetry_lost", "bus_lost"])
def test_flying_on_against_an_objection_is_found(playbook: Playbook, kind: Kind) -> None:
    assert "stopped" in found(fly(playbook, fault(kind), work=blindly(0.6 + 0j, 20.0)))


def test_a_monitor_that_never_suspends_and_a_lease_that_never_ends_are_found(
    playbook: Playbook, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LegFlight, "_overdue", lambda *_: None)
    assert found(fly(playbook, fault("sensor_silent"))) == set()  # the lease alone is enough
    assert "fresh_bearing" in found(fly(playbook, fault("sensor_silent"), mutate=without_lease))


def test_taking_stale_reports_for_news_is_found(playbook: Playbook, monkeypatch: pytest.MonkeyPatch) -> None:
    assert found(fly(playbook, fault("report_delay", amount=1.5))) == set()
    monkeypatch.setattr(ReportChecks, "problem", lambda *_: None)
    assert found(fly(playbook, fault("report_delay", amount=1.5))) == set()  # what waits is looked at again
    assert "fresh_bearing" in found(fly(playbook, fault("report_delay", amount=1.5), mutate=however_old))


def test_commanding_a_pilot_s_vehicle_is_found(playbook: Playbook) -> None:
    run = fly(playbook, fault("pilot_receiver"), work=blindly(0.7 + 0j, 10.0), mutate=deaf_to_the_pilot)
    assert found(run) == {"pilot"}


def test_legs_without_an_end_are_found(playbook: Playbook) -> None:
    assert found(fly(playbook, work=blindly(4 + 0j, 30.0))) == {"leg_length"}
    assert found(fly(playbook, work=blindly(0.02 + 0j, 200.0))) == {"leg_time"}


def test_coming_too_near_is_found_and_so_is_flying_on_there(two: Playbook) -> None:
    def towards(world: FaultyWorld) -> None:
        without_objections(world)
        way = world.vehicles["U2"].place - world.vehicles["U1"].place
        world.executor._bring_by = blindly(2.0 * way / abs(way), abs(way) / 2.0 + 2.0)

    run = fly(two, mutate=towards)
    assert "separation" in found(run)
    assert run.closest_m < 4.0


def test_who_is_lied_to_comes_no_nearer_than_anybody_else() -> None:
    observer = Observer(Rules(0.5, 0.5, 4.0, too_near_m=4.0, tolerance_m=3.0), ("U1",), lied_to=True)
    observer.look(1.0, {"U1": Sight(0j, 0j), "L1": Sight(4.1 + 0j, 0j)})
    assert not observer.findings.all
    observer.look(1.1, {"U1": Sight(0j, 0j), "L1": Sight(3.9 + 0j, 0j)})
    assert [finding.invariant for finding in observer.findings.all] == ["separation"]


def test_placing_without_looking_is_found(playbook: Playbook) -> None:
    run = fly(playbook, work=blindly(2 + 0j, 5.0, placed=True))
    assert found(run) == {"placement"}
    assert run.wrong_placements == 0


def test_placing_against_what_was_heard_is_found_even_from_who_was_lied_to(playbook: Playbook) -> None:
    lie = fault("sensor_bias", amount=0.02)
    run = fly(playbook, lie, work=blindly(2 + 0j, 5.0, placed=True))
    assert "placement" in found(run)
    assert "pass it by" in next(finding.what for finding in run.violations if finding.invariant == "placement")


def test_a_lie_that_nothing_contradicts_is_counted_and_no_violation(playbook: Playbook) -> None:
    lie = fault("sensor_bias", "LOCATING", 0.0, amount=0.1)
    run = fly(playbook, lie)
    assert (run.outcome, run.wrong_placements, run.doubted_placements, run.violations) == ("formed", 1, 0, [])


@pytest.mark.parametrize("amount", [0.03, -0.04, 0.05])
def test_a_lie_told_in_mid_leg_is_not_believed(playbook: Playbook, amount: float) -> None:
    run = fly(playbook, fault("sensor_bias", "LEG_2", amount=amount, of="L0"))
    assert (run.outcome, run.wrong_placements, run.violations) == ("held", 0, [])
    assert "it cannot have flown to" in run.reason


def test_one_that_was_believed_is_counted_as_doubted(playbook: Playbook, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WaryFilter, "_off_sigmas", lambda *_: 0.0)
    run = fly(playbook, fault("sensor_bias", "LEG_2", amount=0.05, of="L0"))
    assert (run.outcome, run.wrong_placements, run.doubted_placements, run.violations) == ("formed", 1, 1, [])


def test_a_vehicle_that_does_not_fly_as_told_is_held_long_before_its_leg_s_time(three: Playbook) -> None:
    run = fly(three, fault("link_cut"))
    assert (run.outcome, run.violations) == ("held", [])
    assert "does not fly as told" in run.reason
    assert run.duration_s < run.struck_s[0] + 15.0


def test_telling_a_vehicle_to_fly_that_does_not_is_found(playbook: Playbook) -> None:
    assert found(fly(playbook, fault("link_cut"), work=blindly(2 + 0j, 20.0))) == {"followed"}


def test_a_leg_that_does_not_end_is_held_at_its_limit(playbook: Playbook, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StopMonitor, "arrived", lambda *_: False)
    run = fly(playbook)
    assert (run.outcome, run.violations) == ("held", [])
    assert "the leg took longer than" in run.reason


def test_an_empty_battery_is_not_flown_on_and_said(playbook: Playbook) -> None:
    run = fly(playbook, fault("battery_low"))
    assert (run.outcome, run.violations) == ("held", [])
    assert "its battery is down to 5 %: land it" in run.reason


def test_a_vehicle_that_reboots_is_its_pilot_s_when_it_is_back(playbook: Playbook) -> None:
    run = fly(playbook, fault("vehicle_reboot", for_s=1.0))
    assert (run.outcome, run.violations) == ("held", [])
    assert "its mode was changed" in run.reason


def test_a_stopped_service_moves_nobody_by_what_is_old(two: Playbook) -> None:
    for for_s, outcome in ((1.0, "formed"), (8.0, "held")):
        run = fly(two, fault("service_stopped", for_s=for_s))
        assert (run.outcome, run.violations) == (outcome, [])
        assert run.struck_s[0] is not None


def test_a_killed_service_leaves_vehicles_that_stop_by_themselves(playbook: Playbook) -> None:
    run = fly(playbook, fault("service_killed"))
    assert (run.outcome, run.violations) == ("killed", [])


@pytest.mark.parametrize(
    "of_the_service", [fault("service_killed", "LEG_2", 3.0), fault("service_stopped", "LEG_2", 3.0, for_s=5.0)]
)
@pytest.mark.parametrize("other", ["bus_lost", "sensor_silent", "telemetry_lost"])
@pytest.mark.parametrize("after_s", [2.8, 3.1])
def test_whoever_the_service_cannot_stop_any_more_stops_by_itself(
    playbook: Playbook, of_the_service: Fault, other: Kind, after_s: float
) -> None:
    run = fly(playbook, of_the_service, fault(other, "LEG_2", after_s))
    assert None not in run.struck_s
    assert run.violations == []


def test_a_service_that_stood_still_for_a_moment_is_excused_for_that_moment(playbook: Playbook) -> None:
    moment = fault("service_stopped", after_s=1.2, for_s=0.3)
    run = fly(playbook, fault("sensor_silent"), moment, work=blindly(0.7 + 0j, 20.0))
    (found_s,) = (finding.time_s for finding in run.violations if finding.invariant == "stopped")
    assert found_s < run.struck_s[0] + 5.5


def test_telling_to_fly_after_the_end_is_found(playbook: Playbook) -> None:
    async def bring(journey: Journey) -> None:
        await blindly(1 + 0j, 1.0, placed=True)(journey)
        asyncio.get_running_loop().call_later(0.3, journey.lease.renew, 1 + 0j)

    assert "ended" in found(fly(playbook, work=bring))


async def _raises(journey: Journey) -> None:
    raise KeyError("no such thing")


async def _waits(journey: Journey) -> None:
    await journey.around.clock.sleep(1e9)


@pytest.mark.parametrize(("work", "words"), [(_raises, "no such thing"), (_waits, "does not end")])
def test_what_ends_in_an_error_or_not_at_all_is_found(
    playbook: Playbook, work: Callable[[Journey], Awaitable[None]], words: str
) -> None:
    run = fly(playbook, work=work)
    assert run.outcome == "broken"
    assert words in run.violations[0].what
