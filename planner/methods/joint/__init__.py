"""The joint method: assignment, order, guides and stop references chosen together.

A receiver may use any transmitters that stand by the time it flies. With the angles a and b of the lines A-D and B-O
against D-O its route is (1 + x) / (1 - x) times the straight line, x = tan(a/2) tan(b/2), so among many transmitters
a nearly straight one is found; what its nearly parallel lines would cost in accuracy, a stop reference of its own for
each leg gives back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.errors import InfeasiblePlanError, Obstruction, PlannerError
from planner.methods import paper
from planner.methods.joint.assembly import assemble
from planner.methods.joint.objectives import parallel_plans, score
from planner.methods.joint.passage import Passage
from planner.methods.joint.shortest import shortest_passages
from planner.methods.joint.trips import shortest_trips, trips_of
from planner.plan import Leg, RelayPlan, Route
from planner.relay import RelayProblem

_LOOSER = (1.25, 1.6, 2.5)
"""Tolerances tried when the one asked for cannot be met, as multiples of it; only up to so many receivers."""
_LOOSENED_UP_TO = 30


def plan(problem: RelayProblem) -> RelayPlan:
    """Return the best relay plan found for the problem's objective, the same for the same problem.

    Raises InfeasiblePlanError when a receiver has no way to a slot, or when only the tolerance cannot be met: then it
    carries the best plan found (`best`), names the receivers that break the tolerance, and says what would help.
    """
    try:
        return _best_plan(problem)
    except InfeasiblePlanError as failure:
        if problem.tolerance_3sigma_m is None:
            raise
        limit_m = problem.tolerance_3sigma_m
        raise _out_of_tolerance(_most_accurate(problem, limit_m), limit_m) from failure


def _best_plan(problem: RelayProblem) -> RelayPlan:
    found: list[RelayPlan] = []
    failure: InfeasiblePlanError | None = None
    try:
        found.append(_shortest_plan(problem))
    except InfeasiblePlanError as error:
        failure = error
    if problem.objective != "length":
        found.extend(parallel_plans(shortest_trips(problem)))
    if failure is not None and not found:
        raise failure
    return min(found, key=lambda one: score(problem, one))


def _shortest_plan(problem: RelayProblem) -> RelayPlan:
    """Return the shortest plan found; where the search is stuck, the paper's chain if that can be flown."""
    try:
        trips, passages = shortest_passages(problem)
    except InfeasiblePlanError:
        chain = _paper_chain(problem)
        if chain is None:
            raise
        return chain
    return assemble(trips, [[passage] for passage in passages])


def _paper_chain(problem: RelayProblem) -> RelayPlan | None:
    """Return the paper's chain with stop references of our own, None where it cannot be flown or is too inaccurate."""
    if problem.max_leg_m is not None or problem.fence or problem.obstacles:
        return None
    try:
        routes = paper.plan(problem).routes
    except PlannerError:
        return None
    places = dict(problem.transmitters) | {route.receiver: route.target for route in routes}
    if any(_passes(places[leg.guide], leg) for route in routes for leg in route.legs):
        return None
    receivers, slots = list(problem.receivers), list(problem.slots)
    receiver = np.array([receivers.index(route.receiver) for route in routes])
    slot = np.array([slots.index(route.slot) for route in routes])
    station = {name: k for k, name in enumerate(problem.transmitters)}
    station |= {route.receiver: len(station) + int(k) for route, k in zip(routes, slot, strict=True)}
    passages = [
        Passage(k, (station[first.guide], station[second.guide]), first.end, route.length_m)
        for k, route in enumerate(routes)
        for first, second in [route.legs]
    ]
    chain = assemble(trips_of(problem, receiver, slot), [[passage] for passage in passages])
    limit_m = problem.tolerance_3sigma_m
    return chain if limit_m is None or not _breaking(chain, limit_m) else None


def _passes(guide: complex, leg: Leg) -> bool:
    """Return whether a leg passes through its guide, where its bearing turns round."""
    return ((leg.start - guide) * (leg.end - guide).conjugate()).real <= 0.0


def _most_accurate(problem: RelayProblem, limit_m: float) -> RelayPlan:
    """Return the plan found under the tightest tolerance that can be met, of a few looser ones; at last under none."""
    for factor in _LOOSER if len(problem.receivers) <= _LOOSENED_UP_TO else ():
        try:
            return _best_plan(replace(problem, tolerance_3sigma_m=factor * limit_m))
        except InfeasiblePlanError:
            continue
    return _best_plan(replace(problem, tolerance_3sigma_m=None))


def _breaking(found: RelayPlan, limit_m: float) -> list[Route]:
    return [route for route in found.routes if (route.predicted_3sigma_m or 0.0) > limit_m]


def _out_of_tolerance(offered: RelayPlan, limit_m: float) -> InfeasiblePlanError:
    """Return the error that names who breaks the tolerance in the plan offered, and what would help."""
    breaking = _breaking(offered, limit_m) or list(offered.routes)
    worst_m = max(route.predicted_3sigma_m or 0.0 for route in offered.routes)
    return InfeasiblePlanError(
        tuple(
            Obstruction(
                route.receiver,
                route.slot,
                f"predicted placement error {route.predicted_3sigma_m or 0.0:.3g} m (3 sigma), "
                f"the tolerance is {limit_m:g} m",
            )
            for route in breaking
        ),
        f"The best plan found meets {worst_m:.3g} m. Allow that, measure with less noise (more samples, a better "
        "sensor, a better located start), or add transmitters off the line of the others.",
        best=offered,
    )
