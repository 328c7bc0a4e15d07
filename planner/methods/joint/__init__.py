"""The joint method: assignment, order, guides and stop references chosen together.

A receiver may use any transmitters that stand by the time it flies. With the angles a and b of the lines A-D and B-O
against D-O its route is (1 + x) / (1 - x) times the straight line, x = tan(a/2) tan(b/2), so among many transmitters
a nearly straight one is found; what its nearly parallel lines would cost in accuracy, a stop reference of its own for
each leg gives back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from planner.errors import InfeasiblePlanError, Obstruction
from planner.methods.joint.assembly import assemble
from planner.methods.joint.chain import papers_chain
from planner.methods.joint.objectives import parallel_plans, score
from planner.methods.joint.shortest import shortest_passages
from planner.methods.joint.trips import shortest_trips
from planner.plan import RelayPlan
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


def first_feasible(problem: RelayProblem, methods: Sequence[Callable[[RelayProblem], RelayPlan]]) -> RelayPlan:
    """Return the plan of the first method that has one; when none has, raise what the first one raised."""
    failures: list[InfeasiblePlanError] = []
    for method in methods:
        try:
            return method(problem)
        except InfeasiblePlanError as failure:
            failures.append(failure)
    raise failures[0]


def _best_plan(problem: RelayProblem) -> RelayPlan:
    found = [] if problem.objective == "length" else list(parallel_plans(shortest_trips(problem)))
    try:
        found.append(first_feasible(problem, (_shortest_plan, papers_chain)))
    except InfeasiblePlanError:
        if not found:
            raise
    return min(found, key=lambda one: score(problem, one))


def _shortest_plan(problem: RelayProblem) -> RelayPlan:
    trips, passages = shortest_passages(problem)
    return assemble(trips, [[passage] for passage in passages])


def _most_accurate(problem: RelayProblem, limit_m: float) -> RelayPlan:
    """Return the plan found under the tightest tolerance that can be met, of a few looser ones; at last under none."""
    for factor in _LOOSER if len(problem.receivers) <= _LOOSENED_UP_TO else ():
        try:
            return _best_plan(replace(problem, tolerance_3sigma_m=factor * limit_m))
        except InfeasiblePlanError:
            continue
    return _best_plan(replace(problem, tolerance_3sigma_m=None))


def _out_of_tolerance(offered: RelayPlan, limit_m: float) -> InfeasiblePlanError:
    """Return the error that names who breaks the tolerance in the plan offered, and what would help."""
    breaking = [route for route in offered.routes if (route.predicted_3sigma_m or 0.0) > limit_m] or list(
        offered.routes
    )
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
