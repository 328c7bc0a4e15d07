"""Waves, makespan and emission of the joint method."""

from __future__ import annotations

import pytest

from planner.methods import joint, paper


def most_on_air(plan):
    on_air = {}
    for route in plan.routes:
        on_air.setdefault(route.wave, set()).update(route.transmitters)
    return max(map(len, on_air.values()))


@pytest.mark.parametrize(("case", "longest_s", "ratio"), [("eight", 42.0, 1.09), ("twenty", 52.0, 1.03)])
def test_balanced_plans_are_quick_and_short(case, longest_s, ratio, request, check_plan):
    problem = request.getfixturevalue(case)(objective="balanced")
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert plan.makespan_s <= longest_s
    assert plan.total_length_m <= ratio * plan.straight_line_bound_m


@pytest.mark.parametrize(("case", "longest_s"), [("eight", 42.0), pytest.param("twenty", 36.0, marks=pytest.mark.slow)])
def test_the_makespan_objective_is_the_quickest(case, longest_s, request, check_plan):
    problem = request.getfixturevalue(case)(objective="makespan")
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert plan.makespan_s <= longest_s


def test_the_emission_objective_needs_few_transmitters(twenty, check_plan, prediction_ratios):
    problem = twenty(objective="emission")
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert most_on_air(plan) <= 4
    assert plan.emission_transmitter_s <= 160.0
    assert abs(prediction_ratios(problem, plan) - 1.0).max() < 0.1


def test_objectives_keep_the_tolerance(eight, check_plan):
    problem = eight(objective="makespan", tolerance_3sigma_m=5.0)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert plan.makespan_s < 70.0


def test_the_papers_chain_takes_much_longer(eight):
    assert paper.plan(eight()).makespan_s == pytest.approx(146.3, abs=0.1)


def test_without_separation_only_the_transmitters_decide_the_waves(eight, check_plan):
    problem = eight(min_separation_m=0.0)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert max(route.wave for route in plan.routes) < 8
