"""Route models I and II, and the general two-leg route they are cases of."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from planner.angles import subtended_angle, wrap
from planner.errors import PlannerError
from planner.routes import (
    Verdict,
    distance_to_segment,
    leg_direction,
    make_leg,
    model_1,
    model_2,
    two_leg_routes,
    two_step,
)

coordinates = st.integers(-15_000, 15_000).map(lambda hundredths: hundredths / 100)
points = st.builds(complex, coordinates, coordinates)

A, B = 0j, 100 + 0j


def well_conditioned(start: complex, target: complex) -> bool:
    """Whether neither model runs close to parallel lines or through a guide."""
    for first, second in ((A, B), (B, A)):
        lines = abs(math.sin(cmath.phase((start - first) / (target - second)))) if start != first else 0.0
        if lines < 0.05 or min(abs(start - p) for p in (A, B)) < 1 or min(abs(target - p) for p in (A, B)) < 1:
            return False
    return True


@given(points, points)
def test_the_paper_s_formulas_give_the_general_turning_point(start: complex, target: complex) -> None:
    assume(abs(target) > 1 and abs(start) > 1 and well_conditioned(start, target))
    for model, guides in ((model_1, (A, B)), (model_2, (B, A))):
        route = model(start, target, A, B)
        general = two_leg_routes(start, target, *guides)
        assume(bool(general.feasible))
        assert complex(general.turning_point) == pytest.approx(route.turning_point, abs=1e-6)
        assert float(general.length_m) == pytest.approx(route.length_m, abs=1e-6)


@given(points, points)
def test_legs_end_on_their_lines_and_at_their_angles(start: complex, target: complex) -> None:
    assume(abs(target) > 1 and abs(start) > 1 and well_conditioned(start, target))
    route = model_1(start, target, A, B)
    turning = route.turning_point
    assume(abs(turning) > 1e-3 and abs(turning - B) > 1e-3)
    assert ((turning - A) * (start - A).conjugate()).imag == pytest.approx(0.0, abs=1e-5)
    assert ((turning - B) * (target - B).conjugate()).imag == pytest.approx(0.0, abs=1e-5)
    if route.rho_f_m > 0 and ((turning - B) * (target - B).conjugate()).real > 0:
        assert wrap(route.alpha_1_rad - float(subtended_angle(turning, A, B))) == pytest.approx(0.0, abs=1e-6)
    assert wrap(route.alpha_2_rad - float(subtended_angle(target, A, B))) == pytest.approx(0.0, abs=1e-9)


@given(points, points, st.floats(-3.0, 3.0), st.floats(0.1, 10.0))
def test_turning_and_scaling_change_nothing_but_the_size(
    start: complex, target: complex, turn: float, scale: float
) -> None:
    assume(abs(target) > 1 and abs(start) > 1 and well_conditioned(start, target))
    factor = cmath.rect(scale, turn)
    here = two_leg_routes(start, target, A, B)
    there = two_leg_routes(start * factor, target * factor, A * factor, B * factor)
    mirrored = two_leg_routes(start.conjugate(), target.conjugate(), A, B)
    assert float(there.length_m) == pytest.approx(float(here.length_m) * scale, rel=1e-6, abs=1e-6)
    assert float(mirrored.length_m) == pytest.approx(float(here.length_m), rel=1e-6, abs=1e-6)
    assert bool(there.feasible) == bool(here.feasible) == bool(mirrored.feasible)


def test_table_6_signs_and_lengths() -> None:
    """U6 of table 6: model II, away from neither by accident: 30.12 then 12.62."""
    start = cmath.rect(97.02, math.radians(257.83))
    before, target = cmath.rect(100, math.radians(200)), cmath.rect(100, math.radians(240))
    route = two_step(start, target, 0j, before)
    assert route.model == "II"
    assert (abs(route.s_1_m), abs(route.s_2_m)) == pytest.approx((30.12, 12.62), abs=0.01)
    assert route.s_1_m < 0 < route.s_2_m  # towards the UAV before, then away from L0
    assert route.alpha_2_rad == pytest.approx(math.radians(70.0))


def test_a_start_on_the_target_s_ray_needs_one_leg() -> None:
    """theta' = 0: D (50, 50) to O (80, 80) about A and B is 42.43 by both models."""
    for model in (model_1, model_2):
        route = model(50 + 50j, 80 + 80j, A, B)
        assert route.length_m == pytest.approx(42.426, abs=1e-3)
        assert min(abs(route.s_1_m), abs(route.s_2_m)) == pytest.approx(0.0, abs=1e-9)


def test_a_start_in_the_slot_does_not_move() -> None:
    assert model_1(30 + 60j, 30 + 60j, A, B).length_m == pytest.approx(0.0, abs=1e-9)
    assert float(two_leg_routes(30 + 60j, 30 + 60j, A, B).length_m) == pytest.approx(0.0, abs=1e-9)


def test_parallel_lines_are_rejected_and_nothing_is_infinite() -> None:
    start, target = 50 + 50j, 150 + 50j  # A-D and B-O have one direction
    routes = two_leg_routes(start, target, A, B)
    assert int(routes.verdict) == Verdict.PARALLEL
    assert np.isfinite(routes.length_m)
    assert np.isfinite(routes.turning_point)
    with pytest.raises(PlannerError, match="parallel"):
        model_1(start, target, A, B)
    assert two_step(start, target, A, B).model == "II"


def test_both_models_parallel_says_so() -> None:
    with pytest.raises(PlannerError, match="parallel"):
        two_step(40 + 0j, 70 + 0j, A, B)


def test_nearly_parallel_lines_are_no_endless_leg() -> None:
    routes = two_leg_routes(50 + 50j, 150.05 + 50j, A, B)
    assert int(routes.verdict) == Verdict.PARALLEL


def test_a_turning_point_on_a_transmitter_is_rejected() -> None:
    """L0, L1 and the slot in one line: leg 2 would begin in L0, where no angle is defined."""
    assert int(two_leg_routes(30 + 60j, -100 + 0j, A, B).verdict) == Verdict.AT_TRANSMITTER


@pytest.mark.parametrize("place", [A, B])
def test_a_start_or_slot_on_a_transmitter_is_rejected(place: complex) -> None:
    assert not bool(two_leg_routes(place, 30 + 60j, A, B, 1.0).feasible)
    assert not bool(two_leg_routes(30 + 60j, place, A, B, 1.0).feasible)


def test_separation_is_kept_from_both_guides() -> None:
    start = cmath.rect(63.22, math.radians(356.41))  # table 4, U1: straight through L1
    target = cmath.rect(100.0, math.tau / 21)
    assert bool(two_leg_routes(start, target, A, B).feasible)
    for guides in ((A, B), (B, A)):
        assert int(two_leg_routes(start, target, *guides, 5.0).verdict) == Verdict.TOO_CLOSE


def test_a_path_exactly_at_the_separation_is_accepted() -> None:
    start, target = 5 + 20j, 5 - 20j  # leg on the line x = 5, past A
    clearance = float(distance_to_segment(start, target, A))
    assert clearance == 5.0
    routes = two_leg_routes(start, target, 5 + 80j, 105 - 20j, 5.0)
    assert float(distance_to_segment(start, complex(routes.turning_point), A)) == pytest.approx(5.0)
    assert bool(two_leg_routes(10 + 0j, 20 + 0j, 5 + 0j, 20 + 40j, 5.0).feasible)
    assert not bool(two_leg_routes(10 + 0j, 20 + 0j, 5 + 0j, 20 + 40j, 5.0 + 1e-6).feasible)


@given(points, points, points)
def test_the_distance_to_a_segment_is_the_least_over_its_points(begin: complex, end: complex, point: complex) -> None:
    sampled = min(abs(begin + t * (end - begin) - point) for t in np.linspace(0.0, 1.0, 400))
    distance = float(distance_to_segment(begin, end, point))
    assert distance <= sampled + 1e-9
    assert distance >= sampled - abs(end - begin) / 399 - 1e-9


@given(st.lists(points, min_size=4, max_size=4))
def test_no_route_is_ever_nan_or_infinite(four: list[complex]) -> None:
    routes = two_leg_routes(*four, min_separation_m=5.0)
    assert np.isfinite(routes.length_m)
    assert np.isfinite(routes.turning_point)


def test_a_leg_knows_its_direction_and_its_stop_angle() -> None:
    leg = make_leg(50 + 50j, 20 + 20j, ("L0", A), (("L0", A), ("L1", B)))
    assert (leg.guide, leg.direction, leg.stop_reference) == ("L0", "towards", ("L0", "L1"))
    assert leg.stop_angle_rad == pytest.approx(float(subtended_angle(20 + 20j, A, B)))
    assert leg.length_m == pytest.approx(abs(30 + 30j))
    assert leg_direction(A, 20 + 20j, 50 + 50j) == "away"


def test_every_verdict_has_words() -> None:
    assert len({verdict.reason for verdict in Verdict}) == len(Verdict)


def test_the_smallest_numbers_are_no_special_case() -> None:
    assert two_step(6j, complex(2.0, 5e-324), A, B).length_m == pytest.approx(two_step(6j, 2 + 0j, A, B).length_m)
