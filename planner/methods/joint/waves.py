"""Waves: which routes may be flown at the same time.

A route may share a wave with another, or overtake it, when it needs none of the other's bearings and their paths stay
apart as whole curves: so the separation holds however late or slow either flies.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.plan import Route
from planner.relay import RelayProblem
from planner.routes import SEPARATION_TOLERANCE_M, Points, distance_to_segment

_BLOCK = 256


def wave_of_each(problem: RelayProblem, routes: Sequence[Route]) -> list[int]:
    """Return the earliest wave of each route, from 1; the routes come in an order in which they may be flown singly."""
    number = {route.receiver: k for k, route in enumerate(routes)}
    keep_apart = paths_too_close(np.array([path_of(route) for route in routes]), problem.min_separation_m)
    waves: list[int] = []
    for k, route in enumerate(routes):
        after = set(np.flatnonzero(keep_apart[k, :k]).tolist())
        after.update(number[name] for name in route.transmitters if name in number)
        waves.append(1 + max((waves[before] for before in after), default=0))
    return waves


def path_of(route: Route) -> tuple[complex, complex, complex]:
    """Return start, turning point and end of a route of at most two legs."""
    return route.start, route.legs[0].end if route.legs else route.start, route.target


def paths_too_close(paths: Points, min_separation_m: float) -> NDArray[np.bool_]:
    """Return which paths, shape (n, 3), come closer to each other than the separation; shape (n, n)."""
    count = len(paths)
    close = np.zeros((count, count), dtype=np.bool_)
    if min_separation_m <= 0.0:
        return close
    least = min_separation_m - SEPARATION_TOLERANCE_M
    for begin in range(0, count, _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        for one in (0, 1):
            for other in (0, 1):
                p, q = paths[rows, one, None], paths[rows, one + 1, None]
                r, s = paths[None, :, other], paths[None, :, other + 1]
                close[rows] |= _segments_cross(p, q, r, s)
                for x, y, z in ((p, q, r), (p, q, s), (r, s, p), (r, s, q)):
                    close[rows] |= distance_to_segment(x, y, z) < least
    return close


def _segments_cross(p: Points, q: Points, r: Points, s: Points) -> NDArray[np.bool_]:
    def side(begin: Points, end: Points, point: Points) -> NDArray[np.float64]:
        return np.imag(np.conj(end - begin) * (point - begin))

    return np.asarray((side(p, q, r) * side(p, q, s) < 0.0) & (side(r, s, p) * side(r, s, q) < 0.0))
