"""A new route for a receiver that cannot keep to its planned one: along what stands, past all that hovers.

It keeps clear of vehicles where they are now, not of others on their way: whoever flies one flies alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from planner.errors import InfeasiblePlanError, PlannerError
from planner.methods.joint import plan
from planner.plan import Route
from planner.relay import RelayProblem
from planner.routes import SEPARATION_TOLERANCE_M, distance_to_segment


def reroute(
    problem: RelayProblem,
    route: Route,
    located: complex,
    standing: Mapping[str, complex],
    hovering: Mapping[str, complex],
) -> Route:
    """Return another route of the same receiver to the same slot, from where it was located.

    `standing` are the transmitters it may use, `hovering` is what else is in the air; points in the formation frame, m.
    Raises PlannerError, in one line, when there is none.
    """
    _require_clear(problem, located, {**problem.obstacles, **hovering, **standing})
    try:
        (found,) = plan(
            replace(
                problem,
                transmitters=dict(standing),
                receivers={route.receiver: located},
                slots={route.slot: route.target},
                objective="length",
                obstacles={**problem.obstacles, **hovering},
                ground_transmitters=problem.ground_transmitters & standing.keys(),
            )
        ).routes
    except InfeasiblePlanError as error:
        reasons = "; ".join(str(obstruction) for obstruction in error.obstructions)
        raise PlannerError(f"{reasons}: have its pilot fly it elsewhere") from error
    return replace(found, order=route.order, wave=route.wave)


def _require_clear(problem: RelayProblem, located: complex, others: Mapping[str, complex]) -> None:
    flying = {name: abs(at - located) for name, at in others.items() if name not in problem.ground_transmitters}
    nearest = min(flying, key=lambda name: flying[name], default=None)
    if nearest is not None and flying[nearest] < problem.min_separation_m - SEPARATION_TOLERANCE_M:
        raise PlannerError(
            f"it hovers only {flying[nearest]:.1f} m from {nearest}, nearer than the separation of "
            f"{problem.min_separation_m:g} m: have its pilot fly it clear"
        )


def passes_near(route: Route, hovering: Mapping[str, complex], min_separation_m: float) -> bool:
    """Return whether a planned route comes nearer to something that hovers than the separation; 0: never."""
    least_m = min_separation_m - SEPARATION_TOLERANCE_M
    return any(
        float(distance_to_segment(leg.start, leg.end, place)) < least_m
        for leg in route.legs
        for place in hovering.values()
    )


def bare_problem(
    routes: Mapping[str, Route],
    transmitters: Mapping[str, complex],
    min_separation_m: float,
    *,
    heading_referenced: bool = True,
) -> RelayProblem:
    """Return the problem that planned routes came from, as far as they tell."""
    return RelayProblem(
        transmitters,
        {name: route.start for name, route in routes.items()},
        {route.slot: route.target for route in routes.values()},
        min_separation_m=min_separation_m,
        heading_referenced=heading_referenced,
    )


def around_routes(problem: RelayProblem, routes: Mapping[str, Route]) -> RelayProblem:
    """Return the problem with the receivers that no route brings anywhere in the way, at their starts."""
    idle = {name: start for name, start in problem.receivers.items() if name not in routes}
    return replace(problem, obstacles={**problem.obstacles, **idle})
