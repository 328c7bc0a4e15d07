"""The joint method on the paper's problems, and its contract."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.errors import InfeasiblePlanError
from planner.formations import circle
from planner.methods import METHODS, joint, paper
from planner.methods.joint.chain import papers_chain
from planner.relay import RelayProblem

COMPASS = {"heading_referenced": True, "tolerance_3sigma_m": 2.5}


def test_it_is_registered():
    assert METHODS["joint"] is joint.plan


def test_shortest_total_of_eight(eight, check_plan):
    problem = eight()
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert plan.total_length_m == pytest.approx(374.937, abs=0.005)
    assert plan.straight_line_bound_m == pytest.approx(364.18, abs=0.01)


def test_shortest_total_of_twenty(twenty, check_plan):
    problem = twenty()
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert plan.total_length_m == pytest.approx(690.735, abs=0.005)


@pytest.mark.parametrize(
    ("case", "options", "longest_m"),
    [
        ("eight", {"tolerance_3sigma_m": 5.0}, 379.0),
        ("eight", COMPASS, 377.5),
        ("twenty", {"tolerance_3sigma_m": 5.0}, 691.5),
        ("twenty", COMPASS, 691.5),
    ],
)
def test_near_straight_plans_keep_the_tolerance(case, options, longest_m, request, check_plan):
    problem = request.getfixturevalue(case)(**options)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert plan.total_length_m <= longest_m


def test_equal_problems_have_equal_plans(eight):
    assert joint.plan(eight()) == joint.plan(eight())


def test_trimmed_plans_are_predicted_more_accurate(eight):
    plain = {route.receiver: route for route in joint.plan(eight()).routes}
    trimmed = joint.plan(eight(map_trim=True)).routes
    assert all(route.predicted_3sigma_m <= plain[route.receiver].predicted_3sigma_m + 1e-9 for route in trimmed)
    assert max(route.predicted_3sigma_m for route in trimmed) < 0.9 * max(
        route.predicted_3sigma_m for route in plain.values()
    )


def test_a_tolerance_nobody_can_meet_offers_the_best_plan(eight):
    with pytest.raises(InfeasiblePlanError, match="the tolerance is") as caught:
        joint.plan(eight(tolerance_3sigma_m=0.5))
    best = caught.value.best
    assert best is not None
    assert len(best.routes) == 8
    breaking = {route.receiver for route in best.routes if route.predicted_3sigma_m > 0.5}
    assert {obstruction.receiver for obstruction in caught.value.obstructions} == breaking
    assert "less noise" in caught.value.way_out


@pytest.mark.slow
def test_a_tolerance_just_missed_is_offered_nearly(twenty):
    with pytest.raises(InfeasiblePlanError) as caught:
        joint.plan(twenty(tolerance_3sigma_m=2.5))
    assert max(route.predicted_3sigma_m for route in caught.value.best.routes) < 1.6 * 2.5


@pytest.mark.slow
def test_a_tighter_tolerance_costs_length(eight, check_plan):
    problem = eight(tolerance_3sigma_m=3.6)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert joint.plan(eight(tolerance_3sigma_m=5.0)).total_length_m < plan.total_length_m < 475.0


def test_more_receivers_than_slots_leave_some_waiting(eight, check_plan):
    problem = replace(eight(), slots=dict(list(circle(8, 100.0).items())[:5]))
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert len(plan.routes) == 5


def test_fewer_receivers_than_slots_fill_the_nearest(twenty, check_plan):
    problem = replace(twenty(), receivers=dict(list(twenty().receivers.items())[:12]))
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert plan.total_length_m < 1.05 * plan.straight_line_bound_m


def test_the_longest_leg_is_kept(eight, check_plan):
    problem = eight(max_leg_m=60.0)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert max(leg.length_m for route in plan.routes for leg in route.legs) <= 60.0


def test_no_leg_leaves_the_fence(eight, check_plan):
    corners = (-125 - 102j, 105 - 102j, 105 + 102j, -125 + 102j)
    problem = eight(fence=corners)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    turns = [leg.end for route in plan.routes for leg in route.legs]
    assert all(-125 <= turn.real <= 105 and abs(turn.imag) <= 102 for turn in turns)


def test_obstacles_are_kept_away_from(eight, check_plan):
    undisturbed = joint.plan(eight())
    longest = max(undisturbed.routes, key=lambda route: route.length_m)
    problem = eight(obstacles={"mast": (longest.start + longest.target) / 2.0})
    check_plan(problem, joint.plan(problem))


def test_ground_transmitters_are_flown_over(check_plan):
    transmitters = {"G": 30 + 2j, "L1": -50 + 3j, "L2": 120 - 4j}
    grounded = RelayProblem(transmitters, {"U": 0j}, {"O": 60 + 0j}, ground_transmitters=frozenset({"G"}))
    plan = joint.plan(grounded)
    check_plan(grounded, plan)
    assert plan.total_length_m < 61.0
    with pytest.raises(InfeasiblePlanError, match="G in the way"):
        joint.plan(replace(grounded, ground_transmitters=frozenset()))


def blocked(problem):
    raise InfeasiblePlanError((), f"no way for {len(problem.receivers)}")


def test_where_one_method_is_stuck_the_next_serves(eight, check_plan):
    problem = eight()
    plan = joint.first_feasible(problem, (blocked, papers_chain))
    check_plan(problem, plan)
    assert plan.total_length_m == pytest.approx(paper.plan(problem).total_length_m)


def test_where_every_method_is_stuck_the_first_ones_reason_is_given(eight):
    problem = replace(eight(), receivers=dict(list(eight().receivers.items())[:4]))
    with pytest.raises(InfeasiblePlanError, match="no way for 4"):
        joint.first_feasible(problem, (blocked, papers_chain))


@pytest.mark.parametrize("heading_referenced", [False, True])
def test_the_papers_chain_is_more_accurate_with_stop_references_of_its_own(eight, heading_referenced):
    problem = eight(heading_referenced=heading_referenced)
    own, papers = (
        max(route.predicted_3sigma_m for route in plan(problem).routes) for plan in (papers_chain, paper.plan)
    )
    assert own < papers


@pytest.mark.parametrize(
    "limits",
    [
        {"fence": (-90 - 90j, 90 - 90j, 90 + 90j, -90 + 90j)},
        {"max_leg_m": 30.0},
        {"tolerance_3sigma_m": 2.0},
        {"obstacles": {"mast": 60 + 65j}},
    ],
)
def test_the_papers_chain_serves_only_within_the_limits(eight, limits):
    with pytest.raises(InfeasiblePlanError, match="the paper's route"):
        papers_chain(eight(**limits))


def test_blocked_receivers_are_named_with_the_reason():
    fenced_in = {f"mast {k}": 20 + 6 * np.exp(1j * k) for k in range(7)}
    problem = RelayProblem({"L0": 0j, "L1": 100 + 0j}, {"U": 60 + 40j}, {"O": 20 + 0j}, obstacles=fenced_in)
    with pytest.raises(InfeasiblePlanError, match="U -> O: blocked") as caught:
        joint.plan(problem)
    assert "step aside" in caught.value.way_out


def test_parallel_lines_are_the_reason():
    problem = RelayProblem({"L0": 0j, "L1": 100 + 0j}, {"U": 20 + 0j}, {"O": -30 + 0j}, min_separation_m=0.0)
    with pytest.raises(InfeasiblePlanError, match="parallel"):
        joint.plan(problem)


@pytest.mark.parametrize("seed", range(6))
def test_never_infeasible_where_the_paper_is_feasible(seed, ring):
    problem = ring(12, seed)
    try:
        chain = paper.plan(problem)
    except InfeasiblePlanError:
        pytest.skip("the paper's chain cannot be flown")
    assert joint.plan(problem).total_length_m <= chain.total_length_m
