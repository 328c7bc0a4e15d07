"""What screens are told of a run is what is the case in it."""

from __future__ import annotations

import asyncio
import itertools
import math

import jsonschema
import msgspec
import pytest

from drivers.bus.messages import encode
from drivers.bus.run_messages import RunSetup, RunState, decode_run, run_json_schemas
from gcs.monitor.leg_geometry import LegGeometry
from gcs.monitor.state import StateTeller
from gcs.monitor.vehicle_states import nearest_others
from gcs.relay.states import ReceiverState
from gcs.safety import PositionBoard, SitePosition
from planner.plan import Leg
from tests.fakes import ManualClock
from tests.gcs.monitor.telling import PX4, ToldWorld, in_mode, vehicle


@pytest.fixture(scope="module")
def told() -> tuple[ToldWorld, list[RunState]]:
    async def fly() -> tuple[ToldWorld, list[RunState]]:
        world = ToldWorld(uavs=8)
        teller, states = StateTeller(world.sources), []
        await world.run(meanwhile=lambda _: states.append(teller.tell()))
        states.append(teller.tell())
        return world, states

    return asyncio.run(fly())


def valid(message: msgspec.Struct) -> None:
    schema = {"$defs": run_json_schemas(), "$ref": f"#/$defs/{type(message).__name__}"}
    jsonschema.validate(msgspec.json.decode(encode(message)), schema)


def test_setup_and_states_come_back_as_they_were_and_are_what_their_schema_says(told) -> None:
    world, states = told
    assert decode_run(encode(world.setup), RunSetup) == world.setup
    valid(world.setup)
    for state in states[::100]:
        assert decode_run(encode(state), RunState) == state
        valid(state)


def test_every_receiver_is_told_in_each_of_its_states_and_at_last_in_its_slot(told) -> None:
    world, states = told
    for number, name in enumerate(world.executor.records):
        seen = [state for state, _ in itertools.groupby(told.receivers[number].state for told in states)]
        flown = [state.value for _, receiver, state, _ in world.history if receiver == name]
        assert seen == ["WAITING", *dict.fromkeys(flown)] or seen == list(dict.fromkeys(flown))
        assert (states[-1].receivers[number].state, states[-1].receivers[number].to_go_s) == ("PLACED", 0.0)
    assert states[-1].to_go_s == 0.0


def test_the_time_to_go_is_about_right_from_the_first_state_on(told) -> None:
    world, states = told
    took_s = states[-1].elapsed_s
    assert world.setup.predicted_s == pytest.approx(took_s, rel=0.1)
    for state in states:
        assert state.to_go_s == pytest.approx(took_s - state.elapsed_s, abs=0.1 * took_s)
    assert states[0].to_go_s == pytest.approx(world.setup.predicted_s)


def test_a_leg_ends_within_its_band_and_the_angle_goes_as_fast_as_is_told(told) -> None:
    _, states = told
    legs = [(state.elapsed_s, state.receivers[0].leg) for state in states if state.receivers[0].leg is not None]
    last = legs[-1][1]
    assert last.number == 2
    assert abs(last.angle_rad - last.stop_angle_rad) < 10 * last.band_rad + math.radians(0.5)  # it is noisy
    steady = [(at_s, leg) for at_s, leg in legs if leg.number == 2 and leg.remaining_m is not None]
    (first_s, first), (later_s, later) = steady[40], steady[100]
    told_rad = sum(leg.rate_radps for _, leg in steady[40:100]) * (later_s - first_s) / 60
    assert told_rad == pytest.approx(later.angle_rad - first.angle_rad, rel=0.05)
    assert later.to_go_s < first.to_go_s


def test_a_flying_receiver_s_bearings_are_fresh_and_say_whom_it_hears(told) -> None:
    _, states = told
    flying = next(state for state in states if state.receivers[0].state == "LEG_2").receivers[0].bearings
    assert flying.age_s < 0.3
    assert set(flying.heard) >= {"L0", "L1"}
    assert 0.0 < flying.sigma_rad < 0.01
    assert flying.received > 0
    assert flying.dropped == {}


def test_while_all_is_well_nothing_is_alarmed(told) -> None:
    _, states = told
    assert [state.alerts for state in states if state.alerts] == []


@pytest.mark.parametrize("along_m", [-20.0, -3.0, 0.0, 2.0])
def test_the_gradient_is_that_of_the_angle(along_m: float) -> None:
    geometry = LegGeometry(Leg("A", "towards", ("A", "B"), 1.0, 3 + 40j, 25 + 20j), 100 + 0j, 30 - 50j)
    at = geometry.at(-along_m, 0.0)
    assert at == pytest.approx(geometry.leg.end + along_m * geometry.course)
    step_m = 1e-3
    difference_rad = geometry.angle_rad(geometry.at(-along_m - step_m, 0.0)) - geometry.angle_rad(at)
    assert geometry.gradient_radpm(at) == pytest.approx(difference_rad / step_m, rel=1e-3)


def test_a_leg_without_length_has_no_gradient() -> None:
    geometry = LegGeometry(Leg("A", "towards", ("A", "B"), 1.0, 5 + 5j, 5 + 5j), 100 + 0j, 30 - 50j)
    assert geometry.gradient_radpm(5 + 5j) == 0.0


@pytest.fixture
def flown() -> tuple[ToldWorld, StateTeller]:
    """A run whose vehicles speak."""
    world = ToldWorld(uavs=8)
    world.sources.vehicles = {name: vehicle(name, world.clock) for name in ("L0", "U1")}
    world.measure()
    return world, StateTeller(world.sources)


def test_a_vehicle_is_told_in_the_formation_frame(flown) -> None:
    world, teller = flown
    world.sources.headings_rad = {"U1": world.frame.axis_azimuth_rad - 0.25}
    state = next(vehicle for vehicle in teller.tell().vehicles if vehicle.name == "U1")
    start = world.executor.records["U1"].route.start
    assert complex(*state.at_m) == pytest.approx(start, abs=0.1)
    north = world.frame.from_site(1 + 0j)
    assert complex(*state.velocity_mps) == pytest.approx(north)
    assert state.heading_rad == pytest.approx(0.25)
    assert (state.mode, state.armed, state.estimator, state.battery_percent) == ("GUIDED", True, "good", 80)
    assert state.silent_s == 0.0


def test_what_a_vehicle_has_not_told_is_not_told(flown) -> None:
    world, teller = flown
    telemetry = world.sources.vehicles["U1"].telemetry
    telemetry.heartbeat = telemetry.kinematics = telemetry.battery = telemetry.relative_altitude_m = None
    telemetry.estimator_flags, telemetry.last_message_s = 0, -math.inf
    world.score.board.latest.clear()
    state = teller.tell()
    assert msgspec.json.decode(encode(state))["vehicles"][1] == {"name": "U1", "system_id": 1}
    assert state.vehicles[1].silent_s is None


def test_modes_are_called_by_their_names(flown) -> None:
    world, teller = flown
    made = world.sources.vehicles["U1"]
    modes = [(3, 5), (3, 77), (PX4, 6 << 16), (PX4, 4 << 16 | 3 << 24), (PX4, 99 << 16), (0, 4)]
    names = []
    for autopilot, mode in modes:
        in_mode(made, mode, autopilot)
        names.append(teller.tell().vehicles[1].mode)
    assert names == ["LOITER", "77", "OFFBOARD", "LOITER", str(99 << 16), "4"]


def test_the_nearest_is_the_nearest() -> None:
    places = {"A": 0j, "B": 3 + 4j, "C": 30 + 0j, "lost": complex(math.nan)}
    board = PositionBoard({name: SitePosition(0.0, at, 20.0) for name, at in places.items()})
    assert nearest_others(board) == {"A": ("B", 5.0), "B": ("A", 5.0), "C": ("B", abs(27 - 4j))}
    assert nearest_others(PositionBoard({"A": SitePosition(0.0, 0j, 20.0)})) == {}


def test_a_held_relay_has_no_time_to_go_and_says_what_helps(flown) -> None:
    world, teller = flown
    record = world.executor.records["U1"]
    record.state, record.reason = ReceiverState.HELD, "held by the operator"
    world.executor.held, world.executor.waiting = "held by the operator", True
    state = teller.tell()
    assert (state.held, state.waiting, state.to_go_s) == ("held by the operator", True, None)
    assert state.ways_out == ["bearing-relay control resume", "bearing-relay control abort"]
    assert state.receivers[0].to_go_s is None
    assert [(alert.level, alert.subject) for alert in state.alerts] == [("alert", "relay")]
    assert "bearing-relay control resume" in state.alerts[0].way_out


def test_since_when_a_receiver_is_in_its_state(flown) -> None:
    world, teller = flown
    teller.tell()
    world.clock.jump(7.0)
    assert teller.tell().receivers[0].since_s == 0.0
    world.executor.records["U1"].state = ReceiverState.LOCATING
    world.clock.jump(2.0)
    assert teller.tell().receivers[0].since_s == pytest.approx(9.0)


def test_states_are_numbered(flown) -> None:
    _, teller = flown
    assert [teller.tell().number for _ in range(3)] == [0, 1, 2]


def test_a_clock_of_the_machine_is_told_besides_the_run_s() -> None:
    world = ToldWorld(uavs=8)
    world.clock = world.status.clock = ManualClock(unix_ns=5)
    state = StateTeller(world.sources).tell()
    assert state.time_ns == 5
    assert state.sent_ns > 1_700_000_000 * 10**9
