"""The paper's formation scheme: its totals, its assignment, its errors, and its refusals."""

from __future__ import annotations

import cmath
import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.assignment import hungarian
from planner.errors import InfeasiblePlanError, ProblemError
from planner.formations import circle
from planner.methods import METHODS
from planner.methods.paper import cost_matrix, plan
from planner.plan import RelayPlan, plan_from_json, plan_to_json
from planner.relay import RelayProblem
from planner.routes import distance_to_segment, two_leg_routes

L0_L1 = {"L0": 0j, "L1": 100 + 0j}


ProblemMaker = Callable[..., RelayProblem]
Printed = Callable[[int, float], RelayProblem]


@pytest.fixture
def printed(eight: ProblemMaker, twenty: ProblemMaker) -> Printed:
    """Return a maker of the paper's problems with a given separation."""
    return lambda uavs, separation: {8: eight, 20: twenty}[uavs](min_separation_m=separation)


def ring_problem(starts: list[complex], separation: float = 0.0) -> RelayProblem:
    receivers = {f"U{number}": start for number, start in enumerate(starts, start=1)}
    return RelayProblem(L0_L1, receivers, circle(len(starts), 100.0), separation)


def assignment(made: RelayPlan) -> dict[str, str]:
    return {route.receiver: route.slot for route in made.routes}


@pytest.mark.parametrize(("uavs", "total", "bound"), [(8, 491.59, 364.18), (20, 830.42, 687.00)])
def test_the_printed_totals_with_separation_off(printed: Printed, uavs: int, total: float, bound: float) -> None:
    made = plan(printed(uavs, 0.0))
    assert made.total_length_m == pytest.approx(total, abs=0.01)
    assert made.straight_line_bound_m == pytest.approx(bound, abs=0.01)
    assert assignment(made) == {f"U{k}": f"O{k}" for k in range(1, uavs + 1)}


def test_the_flyable_chain_of_twenty(printed: Printed) -> None:
    made = plan(printed(20, 5.0))
    shifted = {f"U{k}": f"O{k - 1}" for k in range(2, 17)} | {f"U{k}": f"O{k}" for k in range(17, 21)}
    assert made.total_length_m == pytest.approx(951.32, abs=0.01)
    assert assignment(made) == shifted | {"U1": "O16"}


def test_the_flyable_chain_of_eight_is_the_printed_one(printed: Printed) -> None:
    assert plan(printed(8, 5.0)).total_length_m == pytest.approx(491.59, abs=0.01)


def test_time_and_emission_of_the_chain(printed: Printed) -> None:
    """At 5 m/s and 3 s a stop: 491.59 / 5 + 16 * 3 = 146.3 s, two transmitters on the air throughout."""
    made = plan(printed(8, 5.0))
    assert made.makespan_s == pytest.approx(146.3, abs=0.1)
    assert made.emission_transmitter_s == pytest.approx(2 * made.makespan_s)


@pytest.mark.parametrize("uavs", [8, 20])
def test_every_leg_keeps_the_separation_from_everyone_standing(printed: Printed, uavs: int) -> None:
    problem = printed(uavs, 5.0)
    made = plan(problem)
    for number, route in enumerate(made.routes):
        standing = [
            *problem.transmitters.values(),
            *(done.target for done in made.routes[:number]),
            *(waiting.start for waiting in made.routes[number + 1 :]),
        ]
        for leg in route.legs:
            assert min(float(distance_to_segment(leg.start, leg.end, place)) for place in standing) >= 5.0 - 1e-9


def test_a_receiver_is_guided_by_l0_and_the_uav_in_the_slot_before(printed: Printed) -> None:
    made = plan(printed(8, 5.0))
    assert made.routes[0].transmitters[0] in {"L0", "L1"}
    assert set(made.routes[0].transmitters) == {"L0", "L1"}
    for before, route in zip(made.routes, made.routes[1:], strict=False):
        assert set(route.transmitters) == {"L0", before.receiver}
        assert all(leg.stop_reference == ("L0", before.receiver) for leg in route.legs)


def test_a_standing_uav_in_the_way_costs_the_route() -> None:
    """The cheapest pairing clears its guides but not a UAV still waiting: the next cheapest is taken."""
    problem = ring_problem([-5 + 69j, -85 - 45j, 24 + 59j], 12.0)
    matrix = cost_matrix(problem)
    columns, _ = hungarian(matrix.length_m, matrix.feasible)
    cheapest_m = float(matrix.length_m[range(3), columns].sum())
    assert cheapest_m == pytest.approx(321.18, abs=0.01)
    assert plan(problem).total_length_m == pytest.approx(322.36, abs=0.01)


def test_an_infeasible_problem_says_who_where_and_why() -> None:
    problem = RelayProblem(L0_L1, {"U1": 2 + 1j}, {"O1": 60 + 60j}, 5.0)
    with pytest.raises(InfeasiblePlanError) as caught:
        plan(problem)
    assert [(o.receiver, o.slot) for o in caught.value.obstructions] == [("U1", "O1")]
    assert "U1 -> O1: route model I: a leg passes through" in str(caught.value)
    assert caught.value.way_out in str(caught.value)


def test_a_plan_blocked_only_by_standing_uavs_says_so() -> None:
    """Alone the route is fine; the other receiver waits in the middle of it and has nowhere else to go."""
    way = two_leg_routes(60 + 120j, cmath.rect(100.0, math.tau / 3), 0j, 100 + 0j)
    middle = (60 + 120j + complex(way.turning_point)) / 2
    problem = RelayProblem(L0_L1, {"U1": 60 + 120j, "U2": middle}, circle(2, 100.0), 60.0)
    with pytest.raises(InfeasiblePlanError, match="passes through, or within the separation"):
        plan(problem)


def test_the_chain_needs_a_receiver_for_every_slot() -> None:
    with pytest.raises(ProblemError, match="1 receivers need as many slots, not 2"):
        plan(RelayProblem(L0_L1, {"U1": 50j}, circle(2, 100.0)))


def test_the_cost_matrix_is_what_pair_by_pair_gives(printed: Printed) -> None:
    problem = printed(8, 5.0)
    matrix = cost_matrix(problem)
    slots = list(problem.slots.values())
    for row, start in enumerate(problem.receivers.values()):
        for column, target in enumerate(slots):
            b = slots[column - 1] if column else 100 + 0j
            ways = [two_leg_routes(start, target, *guides, 5.0) for guides in ((0j, b), (b, 0j))]
            lengths = [float(way.length_m) for way in ways if bool(way.feasible)]
            assert bool(matrix.feasible[row, column]) == bool(lengths)
            assert matrix.length_m[row, column] == pytest.approx(min(lengths, default=0.0))


def test_the_hungarian_method_serves_as_many_as_it_can() -> None:
    lengths = np.array([[1.0, 9.0], [2.0, 3.0]])
    columns, blocked = hungarian(lengths, np.array([[True, False], [True, False]]))
    assert blocked.tolist() == [1]
    assert columns[0] == 0
    columns, blocked = hungarian(lengths, np.ones((2, 2), dtype=bool))
    assert columns.tolist() == [0, 1]
    assert blocked.size == 0


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_no_plan_holds_nan_or_infinity(count: int, seed: int) -> None:
    noise = np.random.default_rng(seed)
    starts = noise.uniform(20, 160, count) * np.exp(1j * noise.uniform(0, math.tau, count))
    try:
        made = plan(ring_problem([complex(start) for start in starts], 5.0))
    except InfeasiblePlanError:
        return
    json.dumps(plan_to_json(made), allow_nan=False)
    assert made.total_length_m >= made.straight_line_bound_m - 1e-9


def test_plan_json_there_and_back(printed: Printed) -> None:
    made = plan(printed(8, 5.0))
    again = plan_from_json(json.loads(json.dumps(plan_to_json(made))))
    assert again.total_length_m == made.total_length_m
    for route, same in zip(made.routes, again.routes, strict=True):
        assert (same.receiver, same.slot, same.wave, same.model) == (
            route.receiver,
            route.slot,
            route.wave,
            route.model,
        )
        for leg, copy in zip(route.legs, same.legs, strict=True):
            assert (copy.start, copy.end, copy.guide, copy.direction) == (leg.start, leg.end, leg.guide, leg.direction)
            assert copy.stop_angle_rad == pytest.approx(leg.stop_angle_rad)
    with pytest.raises(KeyError):
        made.route_of("U99")


def test_plan_json_has_the_documented_form(printed: Printed) -> None:
    data = plan_to_json(plan(printed(8, 5.0)))
    assert set(data) == {
        "method", "total_length_m", "straight_line_bound_m", "makespan_s", "emission_transmitter_s", "receivers",
    }  # fmt: skip
    first = data["receivers"][0]
    assert set(first) == {
        "name", "slot", "order", "wave", "route_model", "start_m", "slot_m", "predicted_3sigma_m", "legs",
    }  # fmt: skip
    assert set(first["legs"][0]) == {"guide", "direction", "stop_reference", "stop_angle_deg", "length_m", "end_m"}
    assert first["legs"][-1]["stop_angle_deg"] == pytest.approx(70.0)


def test_the_method_is_registered() -> None:
    assert METHODS["paper"] is plan


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"transmitters": {"L0": 0j}}, "needs two transmitters"),
        ({"receivers": {}}, "at least one receiver"),
        ({"receivers": {"U1": 1j, "U2": 1j}}, "U1 and U2 lie at the same place"),
        ({"receivers": {"L0": 1j}}, "either a transmitter or a receiver"),
        ({"receivers": {"U1": complex("nan")}}, "coordinates must be finite"),
        ({"speed_mps": 0.0}, "speed_mps is 0.0"),
        ({"min_separation_m": float("inf")}, "min_separation_m is inf"),
        ({"stop_s": -1.0}, "stop_s is -1.0"),
    ],
)
def test_what_is_no_problem_is_refused(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {"transmitters": L0_L1, "receivers": {"U1": 50j}, "slots": {"O1": 80 + 10j}}
    with pytest.raises(ProblemError, match=message):
        RelayProblem(**(good | change))  # type: ignore[arg-type]
