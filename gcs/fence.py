"""How far outside a fence a place is."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence


def outside_m(place: complex, corners: Sequence[complex]) -> float:
    """Return how far a place is outside a polygon, in the unit of both; 0 inside, on its edge, or without corners."""
    if not corners or place in corners:
        return 0.0
    edges = list(zip(corners, (*corners[1:], corners[0]), strict=True))
    turned_rad = sum(cmath.phase((end - place) / (begin - place)) for begin, end in edges)
    if abs(turned_rad) > math.pi:
        return 0.0
    return min(_from_edge(place, begin, end) for begin, end in edges)


def _from_edge(place: complex, begin: complex, end: complex) -> float:
    along = end - begin
    share = ((place - begin) * along.conjugate()).real / abs(along) ** 2 if along else 0.0
    return abs(place - begin - max(0.0, min(share, 1.0)) * along)
