"""Objectives: what makes one plan better than another, and the plans that are worth comparing.

The shortest plan is nearly sequential. Shorter times come from sorties of receivers that accept a detour, little
emission from a few beacons that guide everybody else.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from planner.errors import InfeasiblePlanError
from planner.methods.joint.assembly import assemble
from planner.methods.joint.sorties import fly_in_sorties
from planner.methods.joint.trips import Indices, Trips, length_ratio
from planner.plan import RelayPlan
from planner.relay import Objective, RelayProblem

WEIGHTS: dict[Objective, tuple[float, float, float]] = {
    "length": (1.0, 0.0, 0.0),
    "makespan": (1e-3, 1.0, 0.0),
    "emission": (1e-3, 0.0, 1.0),
    "balanced": (1.0, 0.03, 0.003),
}
"""What a plan's length, makespan and emission weigh, each as a multiple of the least conceivable.

The makespan objective takes any detour that saves time, the balanced one only what is worth its length.
"""

_DETOURS = (0.05, 0.07, 0.1, 0.15, 0.2, 0.25, 0.3, 0.5, 1.0)
_BEACON_DETOURS = (0.1, 0.5)
_BEACON_SETS_FLOWN = 16
_BEACON_SLOTS = 40


def score(problem: RelayProblem, plan: RelayPlan) -> float:
    """Return how far the plan is from the least conceivable by the problem's objective; smaller is better."""
    longest_m = max((abs(route.target - route.start) for route in plan.routes), default=0.0)
    least_s = longest_m / problem.speed_mps + 2.0 * problem.stop_s + 1e-9
    least_m = max(plan.straight_line_bound_m, 1e-9)
    by_length, by_makespan, by_emission = WEIGHTS[problem.objective]
    return (
        by_length * plan.total_length_m / least_m
        + by_makespan * plan.makespan_s / least_s
        + by_emission * plan.emission_transmitter_s / (2.0 * least_s)
    )


def parallel_plans(trips: Trips) -> Iterator[RelayPlan]:
    """Yield plans flown in sorties, with more and more detour accepted, then with few beacons."""
    for detour in _DETOURS:
        yield from _flown(trips, detour, None)
    for beacons in _beacon_sets(trips):
        for detour in _BEACON_DETOURS:
            yield from _flown(trips, detour, beacons)


def _flown(trips: Trips, detour: float, beacons: Indices | None) -> Iterator[RelayPlan]:
    sorties = fly_in_sorties(trips, detour, beacons)
    if sorties is None:
        return
    on_air = None
    if beacons is not None:
        on_air = np.arange(trips.stations.size) < len(trips.problem.transmitters)
        on_air[trips.end_station[beacons]] = True
    try:
        yield assemble(trips, sorties, on_air)
    except InfeasiblePlanError:
        return


def _beacon_sets(trips: Trips) -> list[Indices]:
    """Return sets of up to two trips whose receivers would be the best beacons, by the longest route of the others.

    Slots are thinned out to 40 candidates.
    """
    transmitters = list(range(len(trips.problem.transmitters)))
    thinned = np.unique(np.linspace(0, trips.receiver.size - 1, _BEACON_SLOTS).astype(np.intp)).tolist()
    ranked: list[tuple[float, tuple[int, ...]]] = []
    for beacons in (*combinations(thinned, 1), *combinations(thinned, 2)):
        p, q, inverse_p, inverse_q = trips.tangents[
            :, :, transmitters + [int(trips.end_station[trip]) for trip in beacons]
        ].min(axis=-1)
        lengths_m = trips.distance_m * length_ratio(np.minimum(p * q, inverse_p * inverse_q))
        others = np.delete(lengths_m, beacons)
        ranked.append((float(others.max(initial=0.0)) + float(np.sum(others)) / trips.receiver.size, beacons))
    return [np.array(beacons) for _, beacons in sorted(ranked)[:_BEACON_SETS_FLOWN]]
