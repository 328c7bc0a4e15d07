"""Angles wrap in one place; the subtended angle is what geometry says."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.angles import direction, subtended_angle, subtended_by_bearings, wrap, wrap_all
from planner.frames import FormationFrame

angles = st.floats(-50.0, 50.0)
points = st.complex_numbers(max_magnitude=1e3, allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(0.0, 0.0), (math.pi, math.pi), (-math.pi, math.pi), (3 * math.pi, math.pi), (math.tau, 0.0), (-0.1, -0.1)],
)
def test_wrap_at_the_seam(angle: float, wrapped: float) -> None:
    assert wrap(angle) == pytest.approx(wrapped)
    assert wrap_all([angle])[0] == pytest.approx(wrapped)


@given(angles)
def test_wrapping_keeps_the_direction(angle: float) -> None:
    wrapped = wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert cmath.rect(1.0, wrapped) == pytest.approx(cmath.rect(1.0, angle), abs=1e-9)


def test_the_subtended_angle_is_signed_counter_clockwise() -> None:
    assert subtended_angle(0j, 1 + 0j, 1j) == pytest.approx(math.pi / 2)
    assert subtended_angle(0j, 1j, 1 + 0j) == pytest.approx(-math.pi / 2)
    assert subtended_angle(0j, 1 + 0j, -1 + 0j) == pytest.approx(math.pi)


@given(points, points, points, st.floats(-7.0, 7.0))
def test_two_bearings_give_the_subtended_angle(vertex: complex, first: complex, second: complex, axis: float) -> None:
    if min(abs(first - vertex), abs(second - vertex)) < 1e-3:
        return
    frame = FormationFrame(axis)
    azimuths = [direction(frame.to_site(p) - frame.to_site(vertex)) for p in (first, second)]
    measured = subtended_by_bearings(*azimuths)
    assert wrap(measured - float(subtended_angle(vertex, first, second))) == pytest.approx(0.0, abs=1e-6)


def test_subtended_angles_broadcast() -> None:
    seen = subtended_angle(np.zeros(3), np.ones(3), np.array([1j, -1j, 1 + 1j]))
    assert seen == pytest.approx([math.pi / 2, -math.pi / 2, math.pi / 4])
