"""The joint method on large and dense swarms."""

from __future__ import annotations

import numpy as np
import pytest

from planner.methods import joint


def ratio(plan):
    return plan.total_length_m / plan.straight_line_bound_m


def test_a_ring_of_forty(ring, check_plan):
    problem = ring(40, 1)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert ratio(plan) < 1.005


def test_a_small_dense_lattice_has_nothing_blocked(lattice, check_plan):
    problem = lattice(8, 5, 0)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert ratio(plan) < 1.03


def test_a_ring_with_a_tolerance(ring, check_plan):
    problem = ring(60, 2, tolerance_3sigma_m=15.0)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert ratio(plan) < 1.005


@pytest.mark.slow
@pytest.mark.parametrize(("count", "median"), [(20, 1.01), (100, 1.001)])
def test_median_of_twenty_rings(count, median, ring):
    ratios = [ratio(joint.plan(ring(count, seed))) for seed in range(20)]
    assert np.median(ratios) <= median


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_dense_lattice_of_two_hundred_has_nothing_blocked(seed, lattice, check_plan):
    problem = lattice(20, 10, seed)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert ratio(plan) <= 1.03


@pytest.mark.slow
def test_a_ring_of_a_thousand(ring):
    plan = joint.plan(ring(1000, 0))
    assert len(plan.routes) == 1000
    assert ratio(plan) < 1.00001
