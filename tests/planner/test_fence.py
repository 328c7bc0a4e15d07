"""The fence: which segments leave a polygon."""

from __future__ import annotations

import numpy as np
import pytest

from planner.fence import leaves_fence

SQUARE = (0j, 10 + 0j, 10 + 10j, 0 + 10j)
HORSESHOE = (0j, 30 + 0j, 30 + 30j, 20 + 30j, 20 + 10j, 10 + 10j, 10 + 30j, 0 + 30j)


@pytest.mark.parametrize(
    ("begin", "end", "leaves"),
    [
        (1 + 1j, 9 + 9j, False),
        (1 + 1j, 11 + 1j, True),
        (-5 + 5j, 15 + 5j, True),
        (12 + 1j, 15 + 1j, True),
        (0j, 10 + 0j, False),
        (5 + 5j, 5 + 5j, False),
        (0j, 10 + 10j, False),
    ],
)
def test_a_square(begin, end, leaves):
    assert bool(leaves_fence(begin, end, SQUARE)) is leaves
    assert bool(leaves_fence(end, begin, SQUARE)) is leaves


def test_a_horseshoe_is_left_by_crossing_its_mouth():
    begins, ends = np.array([5 + 25j, 5 + 25j, 5 + 5j]), np.array([25 + 25j, 5 + 5j, 25 + 5j])
    assert leaves_fence(begins, ends, HORSESHOE).tolist() == [True, False, False]
