"""A route re-planned from where the receiver was located keeps its guides and reaches its slot."""

from __future__ import annotations

import pytest

from planner.angles import subtended_angle
from planner.errors import PlannerError
from planner.methods.paper import plan
from planner.plan import Leg, Route
from planner.relay import RelayProblem
from planner.replan import replan

PLACES = {"L0": 0j, "L1": 100 + 0j}


def a_route() -> Route:
    return plan(RelayProblem(PLACES, {"U1": 40 + 70j}, {"O1": 70 + 60j})).routes[0]


def test_the_turning_point_moves_with_the_start() -> None:
    route = a_route()
    moved = replan(route, route.start + (2 - 1j), PLACES, 5.0)
    assert moved.start == route.start + (2 - 1j)
    assert moved.legs[0].start == moved.start
    assert moved.legs[0].end == moved.legs[1].start != route.legs[0].end
    assert moved.legs[1].end == route.target
    assert [leg.guide for leg in moved.legs] == [leg.guide for leg in route.legs]
    for leg in moved.legs:
        expected = float(subtended_angle(leg.end, *(PLACES[name] for name in leg.stop_reference)))
        assert leg.stop_angle_rad == pytest.approx(expected)


def test_from_the_planned_start_nothing_changes() -> None:
    route = a_route()
    same = replan(route, route.start, PLACES, 5.0)
    assert same.length_m == pytest.approx(route.length_m)


def test_a_transmitter_standing_a_little_off_is_allowed_for() -> None:
    route = a_route()
    moved = replan(route, route.start, PLACES | {"L1": 100 + 2j}, 5.0)
    assert moved.legs[-1].end == route.target
    assert moved.legs[-1].stop_angle_rad != pytest.approx(route.legs[-1].stop_angle_rad, abs=1e-4)


def test_what_cannot_be_flown_from_there_is_said() -> None:
    with pytest.raises(PlannerError, match=r"U1 cannot fly to O1 from where it was located, \(1\.0, 1\.0\) m"):
        replan(a_route(), 1 + 1j, PLACES, 5.0)


def test_a_route_of_one_leg_just_starts_elsewhere() -> None:
    leg = Leg("L0", "away", ("L0", "L1"), 1.0, 30 + 30j, 60 + 60j)
    route = Route("U1", "O1", 1, 1, "general", 30 + 30j, 60 + 60j, (leg,))
    moved = replan(route, 31 + 30j, PLACES, 5.0)
    assert (moved.legs[0].start, moved.legs[0].end) == (31 + 30j, 60 + 60j)


def test_a_route_without_legs_stays_without() -> None:
    route = Route("U1", "O1", 1, 1, "general", 60 + 60j, 60 + 60j, ())
    assert replan(route, 61 + 60j, PLACES, 5.0).legs == ()
