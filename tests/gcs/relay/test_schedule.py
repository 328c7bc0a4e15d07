"""Who flies next, and who has to fly alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gcs.relay.records import ReceiverRecord
from gcs.relay.rerouting import around_routes, bare_problem, passes_near, reroute
from gcs.relay.schedule import hovering_beside, next_departure
from gcs.relay.standing import Standing
from gcs.relay.states import ReceiverState
from planner.errors import PlannerError
from planner.methods.joint import plan
from planner.relay import RelayProblem
from planner.routes import distance_to_segment

S = ReceiverState
PROBLEM = RelayProblem(
    transmitters={"L0": 0j, "L1": 100 + 0j},
    receivers={"U1": 40 + 70j, "U2": 60 - 60j, "U3": -60 + 30j},
    slots={"O1": 70 + 60j, "O2": 50 - 80j, "O3": -80 + 10j},
    objective="makespan",
    heading_referenced=True,
)


@pytest.fixture
def records() -> dict[str, ReceiverRecord]:
    """Three receivers: two fly together, the third after them."""
    waves = {"U1": 1, "U2": 1, "U3": 2}
    routes = [replace(route, wave=waves[route.receiver]) for route in plan(PROBLEM).routes]
    return {name: ReceiverRecord(route) for name in sorted(waves) for route in routes if route.receiver == name}


def departure(records: dict[str, ReceiverRecord], resumed: set[str] = frozenset()) -> tuple[list[str], bool] | None:
    standing = Standing(PROBLEM.transmitters)
    for name, record in records.items():
        if record.state is S.PLACED:
            standing.places[name] = record.route.target
    found = next_departure(records, resumed, standing, PROBLEM.min_separation_m)
    return None if found is None else (sorted(record.name for record in found.records), found.alone)


def test_a_wave_flies_together_and_the_next_one_after_it(records: dict[str, ReceiverRecord]) -> None:
    assert departure(records) == (["U1", "U2"], False)
    records["U1"].state = records["U2"].state = S.PLACED
    assert departure(records) == (["U3"], False)
    records["U3"].state = S.PLACED
    assert departure(records) is None


def test_whoever_is_held_or_its_pilot_s_flies_only_when_resumed(records: dict[str, ReceiverRecord]) -> None:
    records["U1"].state, records["U2"].state, records["U3"].state = S.HELD, S.PILOT, S.FAILED
    assert departure(records) is None
    assert departure(records, {"U1", "U2", "U3"}) == (["U1"], False)


def test_whoever_has_left_the_plan_flies_first_and_alone(records: dict[str, ReceiverRecord]) -> None:
    records["U2"].state, records["U2"].off_plan = S.HELD, True
    assert departure(records, {"U2"}) == (["U2"], True)
    records["U2"].off_plan = False
    records["U2"].route = replace(records["U2"].route, legs=())
    assert departure(records, {"U2"}) == (["U2"], True)


def test_a_transmitter_that_does_not_stand_makes_its_users_fly_alone(records: dict[str, ReceiverRecord]) -> None:
    leg = replace(records["U3"].route.legs[0], guide="U1")
    records["U3"].route = replace(records["U3"].route, legs=(leg, *records["U3"].route.legs[1:]))
    records["U1"].state, records["U2"].state = S.FAILED, S.PLACED
    assert departure(records) == (["U3"], True)


def test_one_given_up_in_another_s_way_is_flown_round(records: dict[str, ReceiverRecord]) -> None:
    route = records["U2"].route
    in_the_way = (route.start + route.legs[0].end) / 2 if abs(route.legs[0].end - route.start) > 1 else route.start
    records["U1"].state, records["U1"].place = S.FAILED, in_the_way
    assert passes_near(route, {"U1": in_the_way}, 5.0)
    assert not passes_near(route, {"U1": in_the_way}, 0.0)
    assert departure(records) == (["U2"], True)


def test_what_hovers_is_everybody_who_is_not_in_its_slot(records: dict[str, ReceiverRecord]) -> None:
    records["U2"].state, records["U3"].place = S.PLACED, 7 + 7j
    assert hovering_beside("U1", records) == {"U3": 7 + 7j}
    assert hovering_beside("U3", records) == {"U1": 40 + 70j}


def test_a_new_route_keeps_clear_of_what_hovers_and_its_place_in_the_relay(records: dict[str, ReceiverRecord]) -> None:
    route, located = records["U1"].route, 20 - 40j
    standing = {**PROBLEM.transmitters, "U3": -80 + 10j, "U4": 30 + 120j, "U5": 10 - 110j}
    freely = reroute(PROBLEM, route, located, standing, {})
    hovering = {"U2": (located + freely.legs[0].end) / 2}
    found = reroute(PROBLEM, route, located, standing, hovering)
    assert (found.receiver, found.slot, found.order, found.wave) == (route.receiver, route.slot, route.order, 1)
    assert (found.start, found.target) == (located, route.target)
    assert found.legs[0].start == located
    assert abs(found.legs[-1].end - route.target) < 1e-9
    assert found.length_m > freely.length_m
    for leg in found.legs:
        for place in (*hovering.values(), *standing.values()):
            assert distance_to_segment(leg.start, leg.end, place) >= PROBLEM.min_separation_m - 1e-6


def test_without_a_way_the_error_is_one_line_that_says_why(records: dict[str, ReceiverRecord]) -> None:
    route = records["U1"].route
    with pytest.raises(PlannerError, match=r"only 1\.0 m from U2, .*fly it clear"):
        reroute(PROBLEM, route, 20 - 40j, PROBLEM.transmitters, {"U2": 21 - 40j})
    wall = {f"U{k}": route.target + 6.0 * 1j**k for k in range(2, 6)}
    with pytest.raises(PlannerError, match=r"U1 -> O.: blocked") as failure:
        reroute(PROBLEM, route, 20 - 40j, PROBLEM.transmitters, wall)
    assert "\n" not in str(failure.value)
    with pytest.raises(PlannerError, match="two transmitters"):
        reroute(PROBLEM, route, 20 - 40j, {"L0": 0j}, {})


def test_a_receiver_that_no_route_brings_anywhere_stays_in_the_way(records: dict[str, ReceiverRecord]) -> None:
    routes = {name: records[name].route for name in ("U1", "U2")}
    assert around_routes(PROBLEM, routes).obstacles == {"U3": -60 + 30j}
    bare = bare_problem(routes, PROBLEM.transmitters, 4.0)
    assert bare.receivers == {"U1": 40 + 70j, "U2": 60 - 60j}
    assert around_routes(bare, routes).obstacles == {}
    with pytest.raises(PlannerError, match=r"only 2\.0 m from U3"):
        reroute(around_routes(PROBLEM, routes), routes["U1"], -60 + 32j, PROBLEM.transmitters, {})
