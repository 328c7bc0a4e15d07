"""Two-circle positioning: the closed form against forward geometry, every branch, and the paper's table 2."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from planner.angles import subtended_angle
from planner.errors import PositioningError
from planner.positioning import relative_to_target, two_circle, two_circle_candidates, two_circle_unsigned

A, B, C = 0j, 9.55 + 0j, cmath.rect(6.13, math.radians(71.64))
TARGET = cmath.rect(5.30, math.radians(30.91))
TABLE_2 = {
    "Inside": (1.77, 135.26),
    "Left": (6.62, 132.61),
    "Right": (8.38, 16.66),
    "Down": (5.51, -132.28),
    "Top left": (6.72, 89.59),
    "Bottom left": (8.49, -174.11),
    "Bottom right": (9.05, -61.30),
}
CIRCLE_CENTRE = 4.775 + 1.6446588439803233j
CIRCLE_RADIUS = abs(CIRCLE_CENTRE)

coordinates = st.floats(-100.0, 100.0)
points = st.builds(complex, coordinates, coordinates)
unhurried = settings(deadline=None)


def seen_from(d: complex, a: complex = A, b: complex = B, c: complex = C) -> tuple[float, float, float]:
    """The signed angles ADB, ADC and BDC."""
    return tuple(float(subtended_angle(d, p, q)) for p, q in ((a, b), (a, c), (b, c)))  # type: ignore[return-value]


def unsigned(angles: tuple[float, float, float], digits: int | None = None) -> tuple[float, float, float]:
    """The angles without sign, exact or rounded to so many digits of a degree."""
    if digits is None:
        return tuple(abs(angle) for angle in angles)  # type: ignore[return-value]
    return tuple(math.radians(round(math.degrees(abs(angle)), digits)) for angle in angles)  # type: ignore[return-value]


def from_polar_about_target(r: float, theta_deg: float) -> complex:
    return TARGET + cmath.rect(r, math.radians(theta_deg) + cmath.phase(TARGET - A))


def well_conditioned(d: complex, a: complex, b: complex, c: complex) -> bool:
    distances = [abs(p - q) for p, q in ((d, a), (d, b), (d, c), (a, b), (a, c), (b, c))]
    if min(distances) < 1.0:
        return False
    alpha, beta, _ = seen_from(d, a, b, c)
    return float(two_circle(alpha, beta, a, b, c).conditioning) > 0.02


@unhurried
@given(points, points, points, points)
def test_signed_angles_give_the_receiver_back(d, a, b, c):
    assume(well_conditioned(d, a, b, c))
    alpha, beta, _ = seen_from(d, a, b, c)
    fix = two_circle(alpha, beta, a, b, c)
    assert fix.valid
    assert abs(complex(fix.position) - d) < 1e-9


@unhurried
@given(points, points, points, points, st.floats(-math.pi, math.pi), st.floats(0.01, 100.0), points)
def test_rotation_scale_and_shift_move_the_fix_along(d, a, b, c, turn, scale, shift):
    assume(well_conditioned(d, a, b, c))
    alpha, beta, _ = seen_from(d, a, b, c)
    moved = [shift + cmath.rect(scale, turn) * point for point in (d, a, b, c)]
    fix = two_circle(alpha, beta, *moved[1:])
    assert abs(complex(fix.position) - moved[0]) < 1e-8 * max(scale, 1.0)


@unhurried
@given(points, points, points, points)
def test_mirror_changes_the_sign_of_the_angles(d, a, b, c):
    assume(well_conditioned(d, a, b, c))
    alpha, beta, _ = seen_from(d, a, b, c)
    fix = two_circle(-alpha, -beta, a.conjugate(), b.conjugate(), c.conjugate())
    assert abs(complex(fix.position) - d.conjugate()) < 1e-9


@unhurried
@given(points, points, points, points)
def test_relabelling_the_transmitters_changes_nothing(d, a, b, c):
    assume(well_conditioned(d, a, b, c) and well_conditioned(d, b, c, a))
    alpha, _, gamma = seen_from(d, a, b, c)
    fix = two_circle(gamma, -alpha, b, c, a)
    assert abs(complex(fix.position) - d) < 1e-9


def test_a_batch_agrees_with_forward_geometry_on_a_hundred_thousand_cases():
    rng = np.random.default_rng(1)
    d, a, b, c = 100.0 * (rng.uniform(-1, 1, (4, 100_000)) + 1j * rng.uniform(-1, 1, (4, 100_000)))
    fixes = two_circle(subtended_angle(d, a, b), subtended_angle(d, a, c), a, b, c)
    good = fixes.conditioning > 0.02
    error = np.abs(fixes.position - d)
    assert fixes.valid[good].all()
    assert good.mean() > 0.9
    assert error[good].max() < 1e-9
    assert np.median(error) < 1e-12


def test_arguments_broadcast():
    receivers = np.array([[3.0 + 1.0j], [8.0 - 4.0j]])
    fixes = two_circle(
        subtended_angle(receivers, A, np.array([B, C])),
        subtended_angle(receivers, A, 5j - 7),
        A,
        np.array([B, C]),
        5j - 7,
    )
    assert fixes.position.shape == fixes.conditioning.shape == fixes.valid.shape == (2, 2)
    assert np.allclose(fixes.position, receivers)


def test_conditioning_is_the_sine_of_the_documented_angle():
    alpha, beta, _ = seen_from(3 - 7j)
    expected = abs(math.sin(cmath.phase(C) - cmath.phase(B) + alpha - beta))
    assert float(two_circle(alpha, beta, A, B, C).conditioning) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("alpha", "beta", "b", "c"),
    [
        pytest.param(math.pi - 0.3, 0.2, B, C, id="behind"),
        pytest.param(0.0, 0.0, B, C, id="at infinity"),
        pytest.param(0.5, 0.5, A, C, id="two transmitters in one place"),
        pytest.param(math.nan, 0.5, B, C, id="not a number"),
        pytest.param(math.inf, 0.5, B, C, id="infinite"),
    ],
)
def test_what_is_no_fix_is_finite_and_not_valid(alpha, beta, b, c):
    fix = two_circle(alpha, beta, A, b, c)
    assert not fix.valid
    assert fix.position == A
    assert np.isfinite(fix.conditioning)


@pytest.mark.parametrize("name", TABLE_2)
@pytest.mark.parametrize(("digits", "error_radius"), [(None, 1e-9), (2, 0.007)])
def test_table_2_by_third_angle_and_prior(name, digits, error_radius):
    r, theta_deg = TABLE_2[name]
    d = from_polar_about_target(r, theta_deg)
    alpha, beta, third = unsigned(seen_from(d), digits)
    located = two_circle_unsigned(alpha, beta, A, B, C, third_angle=third, prior=TARGET + 0.9 * (d - TARGET))
    found_r, found_theta = relative_to_target(located, A, TARGET)
    assert abs(cmath.rect(found_r, found_theta) - cmath.rect(r, math.radians(theta_deg))) < error_radius


@pytest.mark.parametrize("name", TABLE_2)
@pytest.mark.parametrize(("digits", "error_radius"), [(None, 1e-9), (2, 0.007)])
def test_table_2_by_prior_alone(name, digits, error_radius):
    d = from_polar_about_target(*TABLE_2[name])
    alpha, beta, _ = unsigned(seen_from(d), digits)
    assert abs(two_circle_unsigned(alpha, beta, A, B, C, prior=d + 0.5j) - d) < error_radius


@pytest.mark.parametrize("name", ["Inside", "Left", "Down"])
@pytest.mark.parametrize(("digits", "error_radius"), [(None, 1e-9), (2, 0.007)])
def test_table_2_by_third_angle_alone_where_it_leaves_one(name, digits, error_radius):
    d = from_polar_about_target(*TABLE_2[name])
    alpha, beta, third = unsigned(seen_from(d), digits)
    assert abs(two_circle_unsigned(alpha, beta, A, B, C, third_angle=third) - d) < error_radius


def test_table_2_bottom_right_has_four_candidates():
    candidates = two_circle_candidates(math.radians(24.956), math.radians(27.819), A, B, C)
    expected = [(12.789, 120.64), (13.133, 10.51), (2.722, -148.14), (12.492, -8.54)]
    assert len(candidates) == 4
    for rho, theta_deg in expected:
        assert min(abs(candidate - cmath.rect(rho, math.radians(theta_deg))) for candidate in candidates) < 0.01


@unhurried
@given(points, points, points, points)
def test_the_candidates_hold_the_receiver_and_all_see_the_angles(d, a, b, c):
    assume(well_conditioned(d, a, b, c))
    alpha, beta, _ = unsigned(seen_from(d, a, b, c))
    candidates = two_circle_candidates(alpha, beta, a, b, c)
    assert 1 <= len(candidates) <= 4
    assert min(abs(candidate - d) for candidate in candidates) < 1e-6
    for candidate in candidates:
        if min(abs(candidate - place) for place in (a, b, c)) < 1e-3:
            continue  # so near a transmitter that rounding turns its direction
        seen = seen_from(candidate, a, b, c)
        assert abs(seen[0]) == pytest.approx(alpha, abs=1e-6)
        assert abs(seen[1]) == pytest.approx(beta, abs=1e-6)


@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_each_choice_of_signs_is_found(signs):
    """Bottom right has a candidate on each side of A-B and of A-C."""
    d = from_polar_about_target(*TABLE_2["Bottom right"])
    alpha, beta, _ = unsigned(seen_from(d))
    seen = [seen_from(candidate) for candidate in two_circle_candidates(alpha, beta, A, B, C)]
    assert signs in [(int(math.copysign(1, s[0])), int(math.copysign(1, s[1]))) for s in seen]


def test_coinciding_branches_are_one_candidate():
    d = 20.0 + 0j  # on the line A-B: alpha has no sign
    alpha, beta, _ = unsigned(seen_from(d))
    candidates = two_circle_candidates(alpha, beta, A, B, C)
    assert len({(round(z.real, 6), round(z.imag, 6)) for z in candidates}) == len(candidates)


def test_an_ambiguous_fix_names_the_candidates():
    alpha, beta, third = unsigned(seen_from(from_polar_about_target(*TABLE_2["Right"])))
    with pytest.raises(PositioningError, match=r"fit 10\.2012\+8\.90786j and .*third angle or a prior"):
        two_circle_unsigned(alpha, beta, A, B, C, third_angle=third)


def test_a_prior_between_two_candidates_does_not_decide():
    above = 3.0 + 4.0j
    alpha, beta, _ = unsigned(seen_from(above, A, B, 5 + 0j))
    with pytest.raises(PositioningError, match="as near to"):
        two_circle_unsigned(alpha, beta, A, B, 5 + 0j, prior=3 + 0j)


def test_angles_no_position_can_see_are_refused():
    with pytest.raises(PositioningError, match="no position fits"):
        two_circle_unsigned(math.pi - 0.1, math.pi - 0.1, A, B, C)


def test_a_third_angle_no_candidate_sees_is_refused():
    alpha, beta, third = unsigned(seen_from(from_polar_about_target(*TABLE_2["Inside"])))
    with pytest.raises(PositioningError, match="no position fits"):
        two_circle_unsigned(alpha, beta, A, B, C, third_angle=third - 0.3)


@pytest.mark.parametrize("around_deg", [10, 100, 200, 250, 310])
def test_a_receiver_on_the_circle_of_the_transmitters_is_flagged(around_deg):
    d = CIRCLE_CENTRE + cmath.rect(CIRCLE_RADIUS, math.radians(around_deg))
    angles = seen_from(d)
    fix = two_circle(angles[0], angles[1], A, B, C)
    assert not fix.valid
    assert float(fix.conditioning) < 1e-9
    with pytest.raises(PositioningError, match="every point of the circle"):
        two_circle_unsigned(*unsigned(angles)[:2], A, B, C, third_angle=abs(angles[2]), prior=d)


@pytest.mark.parametrize("off", [0.01, -0.01, 1.0, -1.0])
def test_a_receiver_just_off_the_circle_is_located_and_its_conditioning_tells(off):
    d = CIRCLE_CENTRE + cmath.rect(CIRCLE_RADIUS + off, 4.0)
    angles = seen_from(d)
    fix = two_circle(angles[0], angles[1], A, B, C)
    assert fix.valid
    assert abs(complex(fix.position) - d) < 1e-9
    assert (float(fix.conditioning) < 0.02) == (abs(off) < 0.1)
    assert abs(two_circle_unsigned(*unsigned(angles)[:2], A, B, C, prior=d) - d) < 1e-9


@pytest.mark.parametrize("d", [-3 + 0j, 2 + 0j, 7 + 0j, 30 + 0j])
def test_a_receiver_on_the_line_of_collinear_transmitters_is_flagged(d):
    angles = seen_from(d, A, B, 5 + 0j)
    assert not two_circle(angles[0], angles[1], A, B, 5 + 0j).valid
    with pytest.raises(PositioningError, match="line"):
        two_circle_unsigned(*unsigned(angles)[:2], A, B, 5 + 0j, prior=d)


@pytest.mark.parametrize("d", [3 + 4j, 3 - 4j, -6 + 2j, 20 + 1j])
def test_a_receiver_off_the_line_of_collinear_transmitters_is_located(d):
    angles = seen_from(d, A, B, 5 + 0j)
    assert abs(complex(two_circle(angles[0], angles[1], A, B, 5 + 0j).position) - d) < 1e-9
    assert two_circle_unsigned(*unsigned(angles)[:2], A, B, 5 + 0j, prior=d + 0.3) == pytest.approx(d, abs=1e-9)


@pytest.mark.parametrize("d", [A, B, C])
def test_a_receiver_at_a_transmitter_is_refused(d):
    angles = seen_from(d)
    assert not two_circle(angles[0], angles[1], A, B, C).valid
    for prior in (None, d + 0.1):
        with pytest.raises(PositioningError):
            two_circle_unsigned(*unsigned(angles)[:2], A, B, C, prior=prior)


def test_the_refusal_names_the_transmitter_the_receiver_stands_at():
    alpha, beta, _ = unsigned(seen_from(B))
    with pytest.raises(PositioningError, match="stands at the transmitter"):
        two_circle_unsigned(alpha, beta, A, B, C, prior=B + 0.1)


@unhurried
@given(points, points, points)
def test_polar_coordinates_about_the_target_lead_back(position, a, target):
    assume(abs(target - a) > 1e-3)
    r, theta = relative_to_target(position, a, target)
    assert -math.pi <= theta <= math.pi
    axis = (target - a) / abs(target - a)
    assert abs(target + cmath.rect(r, theta) * axis - position) < 1e-9


@pytest.mark.parametrize(
    ("position", "expected"), [(TARGET * 2, (5.30, 0.0)), (A, (5.30, math.pi)), (TARGET, (0.0, 0.0))]
)
def test_eq_11_holds_where_it_is_printed_as_0_over_0(position, expected):
    r, theta = relative_to_target(position, A, TARGET)
    assert r == pytest.approx(expected[0])
    assert abs(theta) == pytest.approx(expected[1])


def test_no_polar_axis_without_a_distance_to_the_target():
    with pytest.raises(PositioningError, match="polar axis"):
        relative_to_target(1j, A, A)
