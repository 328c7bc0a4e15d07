"""The paper's relay chain from the printed starts: who flies from where to where, by which two guides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs.paper.comparison import Passage
from gcs.paper.places import point
from gcs.paper.printed import LengthTable
from planner.assignment import straight_line_bound
from planner.baselines import Descent, geometric_optimisation
from planner.formations import circle, slot_name
from planner.plan import RelayPlan, Route
from planner.relay import RelayProblem, emission_transmitter_s, makespan_s
from planner.routes import TwoStepRoute, distance_to_segment, make_leg, model_1, model_2

RADIUS_M = 100.0
TRANSMITTERS = {"L0": 0j, "L1": complex(RADIUS_M)}


@dataclass(frozen=True)
class Task:
    """One receiver of the printed chain: its start and slot, and the guides A (L0) and B (the slot before)."""

    receiver: str
    start: complex
    target: complex
    b_name: str
    b: complex

    def models(self) -> tuple[TwoStepRoute, TwoStepRoute]:
        """Return route models I and II."""
        return model_1(self.start, self.target, 0j, self.b), model_2(self.start, self.target, 0j, self.b)

    def descent(self) -> Descent:
        """Return the geometric optimisation, reconstructed, by the bearings of the same two guides."""
        return geometric_optimisation(self.start, self.target, (0j, self.b))

    def passage(self, route: TwoStepRoute) -> Passage:
        """Return how near the route passes to the nearer of its guides."""
        legs = ((self.start, route.turning_point), (route.turning_point, self.target))
        distances_m = {
            name: min(float(distance_to_segment(*leg, at)) for leg in legs)
            for name, at in (("L0", 0j), (self.b_name, self.b))
        }
        nearest = min(distances_m, key=lambda name: distances_m[name])
        return Passage(route.model, nearest, distances_m[nearest])


def tasks(table: LengthTable) -> Iterator[Task]:
    """Yield the tasks of table 3 or 4 in relay order, receiver i to slot i."""
    b_name, b = "L1", TRANSMITTERS["L1"]
    for row, target in zip(table.rows, circle(len(table.rows), RADIUS_M).values(), strict=True):
        yield Task(row.receiver, point(row.start), target, b_name, b)
        b_name, b = row.receiver, target


def problem(table: LengthTable, min_separation_m: float) -> RelayProblem:
    """Return the relay problem of table 3 or 4."""
    return RelayProblem(
        transmitters=TRANSMITTERS,
        receivers={row.receiver: point(row.start) for row in table.rows},
        slots=circle(len(table.rows), RADIUS_M),
        min_separation_m=min_separation_m,
    )


def one_model_plan(table: LengthTable, index: int) -> RelayPlan:
    """Return the plan in which every receiver flies route model I (index 0) or II (1), separation off."""
    routes = tuple(_route(number, task, task.models()[index]) for number, task in enumerate(tasks(table), 1))
    relay = problem(table, 0.0)
    bound_m = straight_line_bound(*(np.array(list(points.values())) for points in (relay.receivers, relay.slots)))
    return RelayPlan("paper", routes, bound_m, makespan_s(relay, routes), emission_transmitter_s(relay, routes))


def _route(number: int, task: Task, route: TwoStepRoute) -> Route:
    a, b = ("L0", 0j), (task.b_name, task.b)
    first, second = (a, b) if route.model == "I" else (b, a)
    legs = (
        make_leg(task.start, route.turning_point, first, (a, b)),
        make_leg(route.turning_point, task.target, second, (a, b)),
    )
    return Route(task.receiver, slot_name(number), number, number, route.model, task.start, task.target, legs)
