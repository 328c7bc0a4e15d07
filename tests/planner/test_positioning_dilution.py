"""Geometric dilution: against a matrix worked out the long way, at the hard places, and its invariances."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from planner.positioning import DILUTION_CAP_M_PER_RAD, dilution

TRIANGLE = [0j, 9.55 + 0j, cmath.rect(6.13, math.radians(71.64))]
CIRCLE_CENTRE = 4.775 + 1.6446588439803233j
CIRCLE_RADIUS = abs(CIRCLE_CENTRE)
AROUND = np.exp(1j * np.linspace(0.1, 6.2, 200))

points = st.builds(complex, st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
unhurried = settings(deadline=None)


def long_way(position: complex, transmitters: list[complex], heading_referenced: bool) -> float:
    """The same by a numerical Jacobian, with the heading as a third unknown."""
    step = 1e-6

    def seen(x: float, y: float) -> np.ndarray:
        return np.angle((np.array(transmitters) - complex(x, y)) / (np.array(transmitters) - position))

    x, y = position.real, position.imag
    columns = [
        (seen(x + step, y) - seen(x - step, y)) / (2 * step),
        (seen(x, y + step) - seen(x, y - step)) / (2 * step),
    ]
    if not heading_referenced:
        columns.append(np.ones(len(transmitters)))
    jacobian = np.column_stack(columns)
    return math.sqrt(np.linalg.inv(jacobian.T @ jacobian)[:2, :2].trace())


@pytest.mark.parametrize("heading_referenced", [True, False])
@unhurried
@given(position=points)
def test_dilution_is_what_the_jacobian_says(heading_referenced, position):
    assume(min(abs(position - place) for place in TRIANGLE) > 0.5)
    gdop = float(dilution(position, TRIANGLE, heading_referenced))
    assume(gdop < 1e4)
    assert gdop == pytest.approx(long_way(position, TRIANGLE, heading_referenced), rel=1e-3)


@pytest.mark.parametrize("heading_referenced", [True, False])
@unhurried
@given(position=points, turn=st.floats(0.0, 6.3), scale=st.floats(0.1, 10.0))
def test_dilution_scales_with_the_field_and_turns_with_it(heading_referenced, position, turn, scale):
    assume(min(abs(position - place) for place in TRIANGLE) > 1e-3)
    before = float(dilution(position, TRIANGLE, heading_referenced))
    assume(before < 1e5)
    rotation = cmath.rect(scale, turn)
    moved = [rotation * place for place in TRIANGLE]
    assert float(dilution(rotation * position, moved, heading_referenced)) == pytest.approx(scale * before, rel=1e-4)


@unhurried
@given(position=points, further=points)
def test_a_known_heading_and_another_transmitter_never_hurt(position, further):
    assume(min(abs(position - place) for place in (*TRIANGLE, further)) > 1e-3)
    free, known = (float(dilution(position, TRIANGLE, heading)) for heading in (False, True))
    assert known <= free * (1 + 1e-6)
    assert float(dilution(position, [*TRIANGLE, further], heading_referenced=False)) <= free * (1 + 1e-6)


def test_dilution_near_the_circle_of_the_transmitters():
    """On it flagged; 0.01 off about 4e3; 1 off about 55."""
    on, near, off = (
        dilution(CIRCLE_CENTRE + (CIRCLE_RADIUS + away) * AROUND, TRIANGLE, heading_referenced=False)
        for away in (0.0, 0.01, 1.0)
    )
    assert (on == DILUTION_CAP_M_PER_RAD).all()
    assert 3e3 < np.median(near) < 5e3
    assert 40 < np.median(off) < 70


@pytest.mark.parametrize("position", [-5 + 0j, 30 + 0j, 70 + 0j, 400 + 0j])
@pytest.mark.parametrize("heading_referenced", [True, False])
def test_dilution_in_line_with_all_transmitters_is_the_cap(position, heading_referenced):
    assert dilution(position, [0j, 50 + 0j, 100 + 0j], heading_referenced) == DILUTION_CAP_M_PER_RAD


@pytest.mark.parametrize("heading_referenced", [True, False])
def test_dilution_at_a_transmitter_or_with_too_few_is_the_cap(heading_referenced):
    enough = 2 if heading_referenced else 3
    assert dilution(TRIANGLE[1], TRIANGLE, heading_referenced) == DILUTION_CAP_M_PER_RAD
    for count in range(1, enough):
        assert dilution(3 + 1j, TRIANGLE[:count], heading_referenced) == DILUTION_CAP_M_PER_RAD
    assert dilution(3 + 1j, TRIANGLE[:enough], heading_referenced) < 100.0


def test_a_field_of_positions_keeps_its_shape_and_is_finite():
    x, y = np.meshgrid(np.linspace(-20, 20, 81), np.linspace(-20, 20, 61))
    field = dilution(x + 1j * y, TRIANGLE, heading_referenced=False)
    assert field.shape == (61, 81)
    assert np.isfinite(field).all()
    assert (field > 0.0).all()
    assert field.max() <= DILUTION_CAP_M_PER_RAD
