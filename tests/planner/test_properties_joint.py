"""What holds for the joint method whatever the problem."""

from __future__ import annotations

import cmath
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from planner.errors import InfeasiblePlanError
from planner.methods import joint
from planner.plan import plan_to_json
from planner.relay import RelayProblem
from planner.routes import general_routes, half_angle_tangents

coordinates = st.floats(-150.0, 150.0, allow_nan=False).map(lambda x: round(x, 2))
points = st.builds(complex, coordinates, coordinates)
bounded = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))


def swarm(count):
    """Transmitters, starts and slots all at least ten units apart."""
    places = st.lists(points, min_size=2 + 2 * count, max_size=2 + 2 * count)
    return places.filter(lambda z: all(abs(z[i] - z[j]) >= 10.0 for i in range(len(z)) for j in range(i)))


def generic(seed, count=3):
    """The same, at random and so in no special position: nothing lines up to within rounding."""
    rng = np.random.default_rng(seed)
    apart = []
    while len(apart) < 2 + 2 * count:
        place = complex(*rng.uniform(-150.0, 150.0, 2))
        if all(abs(place - other) >= 10.0 for other in apart):
            apart.append(place)
    return apart


def problem_of(places, **options):
    count = len(places) // 2 - 1
    return RelayProblem(
        {"L0": places[0], "L1": places[1]},
        {f"U{k}": place for k, place in enumerate(places[2 : 2 + count])},
        {f"O{k}": place for k, place in enumerate(places[2 + count :])},
        **options,
    )


def planned(problem):
    try:
        return joint.plan(problem)
    except InfeasiblePlanError:
        return None


@bounded
@given(places=swarm(3), separation_m=st.sampled_from([0.0, 3.0, 5.0]), heading_referenced=st.booleans())
def test_every_plan_keeps_every_promise(places, separation_m, heading_referenced, check_plan):
    problem = problem_of(places, min_separation_m=separation_m, heading_referenced=heading_referenced)
    plan = planned(problem)
    assume(plan is not None)
    check_plan(problem, plan)
    assert plan.total_length_m >= plan.straight_line_bound_m - 1e-6


@bounded
@given(places=swarm(2), objective=st.sampled_from(["makespan", "emission", "balanced"]))
def test_every_objective_keeps_every_promise(places, objective, check_plan):
    problem = problem_of(places, objective=objective)
    plan = planned(problem)
    assume(plan is not None)
    check_plan(problem, plan)


@bounded
@given(
    seed=st.integers(0, 10**6),
    turn_rad=st.floats(0.0, math.tau),
    scale=st.floats(0.1, 10.0),
    mirrored=st.booleans(),
    shift=points,
)
def test_rotation_mirror_scale_and_shift_change_nothing(seed, turn_rad, scale, mirrored, shift):
    places = generic(seed)
    plan = planned(problem_of(places, min_separation_m=0.0))
    assume(plan is not None)
    moved = [scale * cmath.exp(1j * turn_rad) * (z.conjugate() if mirrored else z) + shift for z in places]
    again = planned(problem_of(moved, min_separation_m=0.0, start_sigma_m=scale))
    assert again is not None
    assert again.total_length_m == pytest.approx(scale * plan.total_length_m, rel=1e-6)


@bounded
@given(seed=st.integers(0, 10**6), order=st.permutations(range(3)))
def test_names_and_their_order_change_nothing(seed, order):
    places = generic(seed)
    problem = problem_of(places, min_separation_m=0.0)
    plan = planned(problem)
    assume(plan is not None)
    shuffled = replace(
        problem,
        transmitters=dict(reversed(problem.transmitters.items())),
        receivers={f"X{k}": list(problem.receivers.values())[k] for k in order},
        slots={f"Y{k}": list(problem.slots.values())[k] for k in order},
    )
    assert planned(shuffled).total_length_m == pytest.approx(plan.total_length_m, rel=1e-9)


@bounded
@given(places=swarm(1))
def test_the_half_angle_tangents_give_the_length(places):
    a, b, start, target = places
    routes = general_routes(start, target, a, b)
    assume(bool(routes.feasible))
    p, _ = half_angle_tangents(start, target, a)
    _, q = half_angle_tangents(start, target, b)
    product = min(p * q, 1.0 / (p * q))
    expected = abs(target - start) * (1.0 + product) / (1.0 - product)
    assert float(routes.length_m) == pytest.approx(float(expected), rel=1e-6)


@bounded
@given(places=st.lists(points, min_size=4, max_size=4))
def test_nothing_but_finite_numbers_leaves_the_planner(places):
    """Points may coincide, line up and lie anywhere."""
    assume(len(set(places[:2])) == 2)
    problem = RelayProblem({"L0": places[0], "L1": places[1]}, {"U": places[2]}, {"O": places[3]}, min_separation_m=0.0)
    plan = planned(problem)
    routes = general_routes(places[2], places[3], places[0], places[1])
    assert np.isfinite(routes.length_m)
    assert np.isfinite(routes.turning_point)
    if plan is not None:
        json.dumps(plan_to_json(plan), allow_nan=False)
