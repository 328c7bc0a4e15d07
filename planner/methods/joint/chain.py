"""The paper's chain as the joint method's last resort, with stop references of its own choice."""

from __future__ import annotations

import math

import numpy as np

from planner.errors import InfeasiblePlanError, Obstruction, ProblemError
from planner.methods import paper
from planner.methods.joint.assembly import assemble
from planner.methods.joint.passage import Passage, can_be_flown
from planner.methods.joint.trips import trips_of
from planner.plan import Leg, RelayPlan, Route
from planner.relay import RelayProblem
from planner.routes import Points

_WAY_OUT = "Use the joint method's own routes."


def papers_chain(problem: RelayProblem) -> RelayPlan:
    """Return the paper's assignment, order and guides, each leg with the stop reference that leaves the least error.

    Raises InfeasiblePlanError where it is no plan for this problem: it cannot be flown, comes too near an obstacle,
    leaves the fence, has too long a leg, passes through a guide or breaks the tolerance.
    """
    try:
        routes = paper.plan(problem).routes
    except ProblemError as error:
        raise InfeasiblePlanError((), f"{error}.") from error
    places = dict(problem.transmitters) | {route.receiver: route.target for route in routes}
    obstacles = np.array(list(problem.obstacles.values()), dtype=np.complex128)
    _refuse(
        [route for route in routes if not _can_be_flown(problem, route, places, obstacles)],
        "the paper's route leaves the limits or passes through its guide",
    )
    receivers, slots = list(problem.receivers), list(problem.slots)
    slot = np.array([slots.index(route.slot) for route in routes])
    station = {name: k for k, name in enumerate(problem.transmitters)}
    station |= {route.receiver: len(station) + int(k) for route, k in zip(routes, slot, strict=True)}
    passages = [
        Passage(k, (station[first.guide], station[second.guide]), first.end, route.length_m)
        for k, route in enumerate(routes)
        for first, second in [route.legs]
    ]
    receiver = np.array([receivers.index(route.receiver) for route in routes])
    chain = assemble(trips_of(problem, receiver, slot), [[passage] for passage in passages])
    limit_m = math.inf if problem.tolerance_3sigma_m is None else problem.tolerance_3sigma_m
    too_inaccurate = [route for route in chain.routes if (route.predicted_3sigma_m or 0.0) > limit_m]
    _refuse(too_inaccurate, "the paper's route breaks the tolerance")
    return chain


def _can_be_flown(problem: RelayProblem, route: Route, places: dict[str, complex], obstacles: Points) -> bool:
    turning = np.array([route.legs[0].end])
    within = can_be_flown(problem, route.start, turning, route.target, obstacles).all()
    return bool(within) and not any(_passes(places[leg.guide], leg) for leg in route.legs)


def _passes(guide: complex, leg: Leg) -> bool:
    """Return whether a leg passes through its guide, where its bearing turns round."""
    return ((leg.start - guide) * (leg.end - guide).conjugate()).real <= 0.0


def _refuse(routes: list[Route], reason: str) -> None:
    if routes:
        raise InfeasiblePlanError(tuple(Obstruction(route.receiver, route.slot, reason) for route in routes), _WAY_OUT)
