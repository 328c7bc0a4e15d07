"""The paper's formation scheme (Algorithm 2): L0 and the previous slot guide each receiver, one receiver at a time.

A is L0 for every receiver; B is the UAV in the slot before, L1 for the first. The cost of receiver and slot is the
shorter of route models I and II (eq. 24); the Hungarian method assigns, and slots are filled in their order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.assignment import hungarian, straight_line_bound
from planner.errors import InfeasiblePlanError, Obstruction, ProblemError
from planner.plan import RelayPlan, Route
from planner.relay import RelayProblem, emission_transmitter_s, makespan_s
from planner.relay_accuracy import relay_accuracy
from planner.routes import SEPARATION_TOLERANCE_M, TwoLegRoutes, Verdict, distance_to_segment, make_leg, two_leg_routes

MODELS = ("I", "II")

_WAY_OUT = "Lower the separation, move a start, or let the receivers use other transmitters than the paper's chain."

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class CostMatrix:
    """Both route models of every receiver (row) to every slot (column), and which of them may be flown."""

    models: tuple[TwoLegRoutes, TwoLegRoutes]
    allowed: NDArray[np.bool_]
    """Shape (2, receivers, slots)."""

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Where at least one model may be flown; shape (receivers, slots)."""
        return np.asarray(self.allowed.any(axis=0))

    @property
    def length_m(self) -> NDArray[np.float64]:
        """Length of the shorter model that may be flown (eq. 24), m; 0 where none may."""
        first, second = (
            np.where(allowed, model.length_m, np.inf) for allowed, model in zip(self.allowed, self.models, strict=True)
        )
        return np.where(self.feasible, np.minimum(first, second), 0.0)

    def model_of(self, row: int, column: int) -> int:
        """Return the index of the shorter model that may be flown; the first when none may."""
        lengths = [
            float(model.length_m[row, column]) if self.allowed[k, row, column] else float("inf")
            for k, model in enumerate(self.models)
        ]
        return lengths.index(min(lengths))


def cost_matrix(problem: RelayProblem) -> CostMatrix:
    """Return the n x n cost matrix of Algorithm 2, line 1, with separation from the two guides."""
    starts = np.array(list(problem.receivers.values()))[:, None]
    slots = np.array(list(problem.slots.values()))[None, :]
    a, b = _guides(problem)
    models = (
        two_leg_routes(starts, slots, a, b[None, :], problem.min_separation_m),
        two_leg_routes(starts, slots, b[None, :], a, problem.min_separation_m),
    )
    return CostMatrix(models, np.stack([model.feasible for model in models]))


def plan(problem: RelayProblem) -> RelayPlan:
    """Return the paper's relay plan.

    Separation 0 switches the separation off and gives the printed totals. Raises ProblemError unless there are as many
    slots as receivers, InfeasiblePlanError when some receiver has no route to any free slot. The predicted error of a
    placement is None from where the chain's error is out of proportion (see `relay_accuracy`).
    """
    if len(problem.receivers) != len(problem.slots):
        raise ProblemError(
            f"the paper's chain fills every slot in turn: {len(problem.receivers)} receivers need as many slots, "
            f"not {len(problem.slots)}"
        )
    matrix = cost_matrix(problem)
    while True:
        columns, blocked = hungarian(matrix.length_m, matrix.feasible)
        if blocked.size:
            raise InfeasiblePlanError(_obstructions(problem, matrix, columns, blocked), _WAY_OUT)
        breaches = _separation_breaches(problem, matrix, columns)
        if not breaches:
            break
        for model, row, column in breaches:
            matrix.allowed[model, row, column] = False
    routes = _with_accuracy(problem, _routes(problem, matrix, columns))
    return RelayPlan(
        method="paper",
        routes=routes,
        straight_line_bound_m=straight_line_bound(
            np.array(list(problem.receivers.values())), np.array(list(problem.slots.values()))
        ),
        makespan_s=makespan_s(problem, routes),
        emission_transmitter_s=emission_transmitter_s(problem, routes),
    )


def _guides(problem: RelayProblem) -> tuple[complex, NDArray[np.complex128]]:
    """Return A, and B for each slot: the slot before it, L1 for the first."""
    a, first_b, *_ = problem.transmitters.values()
    return a, np.array([first_b, *list(problem.slots.values())[:-1]])


def _separation_breaches(problem: RelayProblem, matrix: CostMatrix, columns: Indices) -> list[tuple[int, int, int]]:
    """Return (model, row, column) of every chosen route that passes too close to a UAV standing while it is flown.

    Standing are the first transmitters, the slots filled before, and the receivers still waiting at their starts.
    """
    if problem.min_separation_m <= 0.0:
        return []
    starts, slots = np.array(list(problem.receivers.values())), np.array(list(problem.slots.values()))
    transmitters = np.array(list(problem.transmitters.values()))
    row_of = np.argsort(columns)
    breaches: list[tuple[int, int, int]] = []
    for column, row in enumerate(row_of):
        model = matrix.model_of(row, column)
        turning = matrix.models[model].turning_point[row, column]
        standing = np.concatenate([transmitters, slots[:column], starts[row_of[column + 1 :]]])
        clearance_m = np.minimum(
            distance_to_segment(starts[row], turning, standing), distance_to_segment(turning, slots[column], standing)
        )
        if clearance_m.min() < problem.min_separation_m - SEPARATION_TOLERANCE_M:
            breaches.append((model, int(row), column))
    return breaches


def _routes(problem: RelayProblem, matrix: CostMatrix, columns: Indices) -> tuple[Route, ...]:
    receivers, slots = list(problem.receivers.items()), list(problem.slots.items())
    receiver_of = {int(column): receivers[row][0] for row, column in enumerate(columns)}
    (a_name, a), (b_name, b), *_ = problem.transmitters.items()
    routes: list[Route] = []
    for column, row in enumerate(np.argsort(columns)):
        name, start = receivers[row]
        slot, target = slots[column]
        model = matrix.model_of(row, column)
        turning = complex(matrix.models[model].turning_point[row, column])
        guide_a, guide_b = (a_name, a), (b_name, b)
        first, second = (guide_a, guide_b) if MODELS[model] == "I" else (guide_b, guide_a)
        reference = (guide_a, guide_b)
        legs = (make_leg(start, turning, first, reference), make_leg(turning, target, second, reference))
        routes.append(Route(name, slot, column + 1, column + 1, MODELS[model], start, target, legs))
        b_name, b = receiver_of[column], target
    return tuple(routes)


def _with_accuracy(problem: RelayProblem, routes: tuple[Route, ...]) -> tuple[Route, ...]:
    accuracy = relay_accuracy(problem, routes)
    predicted_m = {name: placement.worst_axis_3sigma_m for name, placement in accuracy.items()}
    return tuple(replace(route, predicted_3sigma_m=predicted_m.get(route.receiver)) for route in routes)


def _obstructions(
    problem: RelayProblem, matrix: CostMatrix, columns: Indices, blocked: Indices
) -> tuple[Obstruction, ...]:
    receivers, slots = list(problem.receivers), list(problem.slots)
    return tuple(
        Obstruction(
            receivers[row],
            slots[columns[row]],
            "; ".join(
                f"route model {name}: {_verdict(model, int(row), int(columns[row])).reason}"
                for name, model in zip(MODELS, matrix.models, strict=True)
            ),
        )
        for row in blocked
    )


def _verdict(model: TwoLegRoutes, row: int, column: int) -> Verdict:
    """Return why this route may not be flown; one found feasible by itself was ruled out by the separation."""
    verdict = Verdict(int(model.verdict[row, column]))
    return Verdict.TOO_CLOSE if verdict is Verdict.FEASIBLE else verdict
