"""What the paper compares with: a descent on angle errors, and trilateration from angles."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from planner.angles import wrap, wrap_all
from planner.baselines import geometric_optimisation, squared_angle_error, trilateration, trilateration_angles
from planner.errors import PositioningError, ProblemError
from planner.positioning import two_circle

A, B, C = 0j, 100 + 0j, 30 + 80j
SLOT = cmath.rect(100.0, math.radians(40.0))
START = cmath.rect(75.58, math.radians(4.66))

coordinates = st.floats(-200.0, 200.0)
points = st.builds(complex, coordinates, coordinates)


def _apart(*places: complex) -> bool:
    return min(abs(p - q) for k, p in enumerate(places) for q in places[:k]) > 5.0


def _smooth(at: complex, target: complex, transmitters: np.ndarray) -> bool:
    """Whether no angle, nor difference of angles, is wrong by just half a turn: there the squared error has a kink."""
    wrong = wrap_all(np.angle(transmitters - at) - np.angle(transmitters - target))
    both = wrap_all([*wrong, *(wrong[:, None] - wrong[None, :]).ravel()])
    return bool(np.abs(both).max() < math.pi - 1e-3)


@given(points, points, st.booleans())
def test_the_gradient_is_the_numeric_one(at, target, heading_referenced):
    transmitters = np.array([A, B, C])
    assume(_apart(at, A, B, C) and _apart(target, A, B, C))

    def square(place: complex) -> float:
        return squared_angle_error(place, target, transmitters, heading_referenced=heading_referenced)[0]

    assume(_smooth(at, target, transmitters))
    step_m = 1e-4
    _, gradient = squared_angle_error(at, target, transmitters, heading_referenced=heading_referenced)
    slopes = [(square(at + turn * step_m) - square(at - turn * step_m)) / (2 * step_m) for turn in (1, 1j)]
    assert abs(complex(*slopes) - gradient) < 1e-6


@pytest.mark.parametrize(
    ("transmitters", "heading_referenced"), [((A, B), True), ((A, B, C), True), ((A, B, C), False)]
)
def test_a_descent_ends_in_the_slot(transmitters, heading_referenced):
    descent = geometric_optimisation(START, SLOT, transmitters, heading_referenced=heading_referenced)
    assert descent.converged
    assert descent.error_rad <= 1e-4
    assert abs(descent.places[-1] - SLOT) < 0.1
    assert descent.places[0] == START
    assert descent.length_m >= abs(SLOT - START) - 0.1


@given(points, points, st.booleans())
def test_every_step_lowers_the_error_and_nothing_is_ever_undefined(start, target, heading_referenced):
    transmitters = (A, B, C)
    assume(_apart(target, *transmitters))
    descent = geometric_optimisation(start, target, transmitters, heading_referenced=heading_referenced, max_steps=60)
    squares = [
        squared_angle_error(place, target, np.array(transmitters), heading_referenced=heading_referenced)[0]
        for place in descent.places
    ]
    assert np.isfinite(descent.places).all()
    assert math.isfinite(descent.length_m)
    assert all(after < before for before, after in pairwise(squares))
    assert descent.steps <= 60
    assert descent.converged == (descent.error_rad <= 1e-4)


@pytest.mark.parametrize("turn", [1j, cmath.rect(3.0, 0.7), 1e-3, 1e4])
def test_a_descent_turns_and_grows_with_the_field(turn):
    plain = geometric_optimisation(START, SLOT, (A, B))
    moved = geometric_optimisation(START * turn, SLOT * turn, (A * turn, B * turn))
    assert moved.steps == plain.steps
    assert np.allclose(moved.places, np.array(plain.places) * turn, rtol=1e-6, atol=1e-6 * abs(turn))


def test_a_descent_mirrors_with_the_field():
    mirrored = geometric_optimisation(START.conjugate(), SLOT.conjugate(), (A, B))
    assert np.allclose(mirrored.places, np.conj(geometric_optimisation(START, SLOT, (A, B)).places))


def test_the_same_task_gives_the_same_descent():
    assert geometric_optimisation(START, SLOT, (A, B)) == geometric_optimisation(START, SLOT, (A, B))


def test_a_receiver_in_its_slot_stays():
    descent = geometric_optimisation(SLOT, SLOT, (A, B))
    assert (descent.steps, descent.length_m, descent.converged) == (0, 0.0, True)


def test_the_steps_are_bounded_and_an_unfinished_descent_says_so():
    descent = geometric_optimisation(START, SLOT, (A, B), max_steps=2)
    assert descent.steps == 2
    assert not descent.converged


@pytest.mark.parametrize("start", [A, 50 + 0j, -300 + 0j, 1e9 + 1e9j])
def test_an_awkward_start_ends_with_numbers(start):
    descent = geometric_optimisation(start, SLOT, (A, B))
    assert np.isfinite(descent.places).all()
    assert math.isfinite(descent.error_rad)


def test_it_ends_where_the_gradient_vanishes():
    descent = geometric_optimisation(50 + 0j, 50 + 40j, (A, B), heading_referenced=False)
    assert descent.places[-1] == pytest.approx(50 + 40j, abs=0.1)
    stuck = geometric_optimisation(0j, 50j, (-50 + 0j, 50 + 0j), heading_referenced=False)
    assert np.isfinite(stuck.places).all()


def test_it_ends_where_the_error_falls_no_further():
    descent = geometric_optimisation(START, SLOT, (A, B), tolerance_rad=0.0)
    assert descent.steps < 100
    assert descent.error_rad < 1e-12


@pytest.mark.parametrize(
    ("target", "transmitters", "words"),
    [
        (SLOT, (A,), "two transmitters fix a place, 1 do not"),
        (SLOT, (A, complex("nan")), "coordinates must be finite"),
        (complex(math.inf, 0.0), (A, B), "coordinates must be finite"),
        (B, (A, B), "is at a transmitter"),
    ],
)
def test_what_is_no_task_is_refused(target, transmitters, words):
    with pytest.raises(ProblemError, match=words):
        geometric_optimisation(START, target, transmitters)


@given(points)
def test_trilateration_agrees_with_two_circle_positioning(at):
    assume(_apart(at, A, B, C))
    alpha, beta, gamma = trilateration_angles(at, A, B, C)
    assume(min(abs(math.sin(angle)) for angle in (alpha, beta, gamma)) > 0.02)
    fix = two_circle(alpha, beta, A, B, C)
    assume(fix.conditioning > 0.02)
    assert abs(trilateration(alpha, beta, gamma, A, B, C) - at) < 1e-6
    assert abs(complex(fix.position) - at) < 1e-6


def test_the_third_angle_is_measured_by_itself():
    at = 60 + 40j
    alpha, beta, gamma = trilateration_angles(at, A, B, C)
    assert gamma == pytest.approx(wrap(beta - alpha))
    assert 1e-3 < abs(trilateration(alpha, beta, gamma + 0.01, A, B, C) - at) < 5.0


@pytest.mark.parametrize("at", [50 + 0j, 150 + 0j, -40 + 0j])
def test_in_line_with_two_transmitters_trilateration_fails_where_two_circles_do_not(at):
    alpha, beta, gamma = trilateration_angles(at, A, B, C)
    with pytest.raises(PositioningError, match="in line with"):
        trilateration(alpha, beta, gamma, A, B, C)
    assert complex(two_circle(alpha, beta, A, B, C).position) == pytest.approx(at)


def test_on_the_circle_through_the_transmitters_trilateration_fails():
    circle = [cmath.rect(50.0, angle) for angle in (0.1, 2.0, 4.0)]
    angles = trilateration_angles(cmath.rect(50.0, 5.0), *circle)
    with pytest.raises(PositioningError, match="on the circle through"):
        trilateration(*angles, *circle)


def test_two_transmitters_in_one_place_fix_nothing():
    with pytest.raises(PositioningError, match="in line with"):
        trilateration(0.5, 0.6, 0.1, A, A, C)
