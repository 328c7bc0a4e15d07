"""A place is inside a fence, on it, or so far outside."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.fence import outside_m

SQUARE = (0j, 10 + 0j, 10 + 10j, 10j)
NOTCHED = (0j, 10 + 0j, 10 + 10j, 5 + 2j, 10j)
"""With a bay in its upper side."""


@pytest.mark.parametrize(
    ("place", "corners", "expected_m"),
    [
        (5 + 5j, SQUARE, 0.0),
        (10 + 5j, SQUARE, 0.0),
        (0j, SQUARE, 0.0),
        (12 + 5j, SQUARE, 2.0),
        (13 + 14j, SQUARE, 5.0),
        (-3 - 4j, SQUARE, 5.0),
        (5 + 5j, NOTCHED, abs((5 + 5j) - (5 + 2j)) * 5 / abs(5 + 8j)),
        (2 + 4j, NOTCHED, 0.0),
        (1000j, (), 0.0),
    ],
)
def test_outside_counts_to_the_nearest_edge(place: complex, corners: tuple[complex, ...], expected_m: float) -> None:
    assert outside_m(place, corners) == pytest.approx(expected_m, abs=1e-9)


coordinate = st.floats(-100.0, 100.0)


@given(coordinate, coordinate)
def test_it_is_the_same_either_way_round_and_wherever_the_fence_lies(x: float, y: float) -> None:
    place, away = complex(x, y), complex(3.0, -7.0)
    expected_m = outside_m(place, SQUARE)
    assert outside_m(place, SQUARE[::-1]) == pytest.approx(expected_m, abs=1e-6)
    assert outside_m(place + away, [corner + away for corner in SQUARE]) == pytest.approx(expected_m, abs=1e-6)
