"""Passage: which routes of one trip can be flown past everything that stands in the air at that time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.fence import leaves_fence
from planner.methods.joint.guides import ranked_pairs
from planner.methods.joint.trips import Mask, Trips
from planner.relay import RelayProblem
from planner.routes import SEPARATION_TOLERANCE_M, Points, distance_to_segment, general_routes

_NEAR_STRAIGHT = ((1, 1), (6, 72))
"""Guides of every kind, and routes, tried in turn."""
_WIDE = ((24, 1152),)
_ABREAST = 200_000
"""Route-obstacle pairs checked at once."""


@dataclass(frozen=True)
class Passage:
    """One route that can be flown: the trip, its guides (station indices) and its turning point."""

    trip: int
    guides: tuple[int, int]
    turning_point: complex
    length_m: float


def passages(
    trips: Trips, trip: int, standing: Mask, waiting: Mask, *, wide: bool = False, on_air: Mask | None = None
) -> Iterator[Passage]:
    """Yield the routes of a trip that can be flown, the shortest first within each batch.

    `standing`, shape (K,), says which stations transmit; `waiting`, shape (n,), which receivers are still at their
    starts. `wide` looks at many more routes than the nearly straight ones; `on_air`, shape (K,), limits the guides.
    """
    stations = np.flatnonzero(standing if on_air is None else standing & on_air)
    start, target = trips.starts[trips.receiver[trip]], trips.slots[trips.slot[trip]]
    obstacles = standing_in_the_air(trips, trip, standing, waiting)
    if start == target:
        free = not np.any(trips.stations[standing] == start)
        if free and can_be_flown(trips.problem, start, np.array([start]), target, obstacles).all():
            yield Passage(trip, (-1, -1), complex(start), 0.0)
        return
    tried: set[tuple[int, int]] = set()
    for per_side, most in _WIDE if wide else _NEAR_STRAIGHT:
        first, second = ranked_pairs(trips.tangents[:, trip, stations], per_side)
        first, second = stations[first[:most]], stations[second[:most]]
        fresh = np.array([pair not in tried for pair in zip(first.tolist(), second.tolist(), strict=True)], dtype=bool)
        first, second = first[fresh], second[fresh]
        tried.update(zip(first.tolist(), second.tolist(), strict=True))
        step = max(1, _ABREAST // max(1, obstacles.size))
        for begin in range(0, first.size, step):
            a, b = first[begin : begin + step], second[begin : begin + step]
            routes = general_routes(start, target, trips.stations[a], trips.stations[b])
            turning = routes.turning_point
            clear = routes.feasible & can_be_flown(trips.problem, start, turning, target, obstacles)
            for k in np.flatnonzero(clear):
                yield Passage(trip, (int(a[k]), int(b[k])), complex(turning[k]), float(routes.length_m[k]))


def standing_in_the_air(trips: Trips, trip: int, standing: Mask, waiting: Mask) -> Points:
    """Return everything the receiver of a trip has to keep away from."""
    problem = trips.problem
    if problem.min_separation_m <= 0.0:
        return np.zeros(0, dtype=np.complex128)
    in_the_air = standing.copy()
    for k, name in enumerate(problem.transmitters):
        in_the_air[k] &= name not in problem.ground_transmitters
    others = waiting.copy()
    others[trips.receiver[trip]] = False
    extra = np.array(list(problem.obstacles.values()), dtype=np.complex128)
    return np.concatenate([trips.stations[in_the_air], trips.starts[others], extra])


def can_be_flown(problem: RelayProblem, start: complex, turning: Points, target: complex, obstacles: Points) -> Mask:
    """Return which routes start -> turning -> target keep the separation, the longest leg and the fence."""
    clear = np.ones(turning.shape, dtype=np.bool_)
    if obstacles.size:
        least = problem.min_separation_m - SEPARATION_TOLERANCE_M
        for begin, end in ((start, turning[:, None]), (turning[:, None], target)):
            clear &= distance_to_segment(begin, end, obstacles).min(axis=-1) >= least
    if problem.max_leg_m is not None:
        clear &= np.maximum(np.abs(turning - start), np.abs(target - turning)) <= problem.max_leg_m
    if problem.fence:
        clear &= ~leaves_fence(start, turning, problem.fence) & ~leaves_fence(turning, target, problem.fence)
    return clear
