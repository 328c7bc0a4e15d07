"""Recomputes the paper's tables 2 to 6 with the planner and sets every number beside the printed one."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from gcs.paper.comparison import (
    ROUNDING_M,
    Comparison,
    LegsComparison,
    LengthResult,
    LengthsResult,
    ModelsResult,
    ModelsTable,
    PaperComparison,
    Passage,
    PositioningResult,
)
from gcs.paper.printed import Legs, LengthTable, ModelTable, Polar, Positioning, PositioningCase, PrintedPaper
from planner.angles import subtended_angle
from planner.formations import circle
from planner.methods import METHODS
from planner.plan import RelayPlan
from planner.positioning import two_circle, two_circle_candidates
from planner.relay import RelayProblem
from planner.routes import TwoStepRoute, distance_to_segment, model_1, model_2

FLYABLE_SEPARATION_M = 5.0

_RADIUS_M = 100.0
_TRANSMITTERS = {"L0": 0j, "L1": complex(_RADIUS_M)}


def recompute(printed: PrintedPaper) -> PaperComparison:
    """Return everything the paper prints, recomputed from the printed starts."""
    table_3 = _lengths(printed.table_3)
    return PaperComparison(
        printed=printed,
        table_2=tuple(_positioning(printed.table_2, case) for case in printed.table_2.cases),
        table_3=table_3,
        table_4=_lengths(printed.table_4),
        table_5=_total(printed.table_5[1].total, (row.length.recomputed for row in table_3.rows)),
        table_6=_models(printed.table_6, printed.table_3),
        flyable=_plan(printed.table_4, FLYABLE_SEPARATION_M),
    )


def _point(place: Polar) -> complex:
    return cmath.rect(place[0], math.radians(place[1]))


def _positioning(setting: Positioning, case: PositioningCase) -> PositioningResult:
    a, b, c, target = 0j, complex(setting.b), _point(setting.c), _point(setting.target)
    true = target + _point(case.position) * target / abs(target)
    alpha, beta = (float(subtended_angle(true, a, other)) for other in (b, c))

    def error_m(first: float, second: float) -> float:
        return abs(complex(two_circle(first, second, a, b, c).position) - true)

    return PositioningResult(
        printed=case,
        exact_m=error_m(alpha, beta),
        rounded_m=error_m(_rounded(alpha), _rounded(beta)),
        printed_estimate_m=abs(_point(case.estimate) - _point(case.position)),
        candidates=len(two_circle_candidates(abs(alpha), abs(beta), a, b, c)),
    )


def _rounded(angle: float) -> float:
    """Return the angle rounded to 0.01 degree, rad."""
    return math.radians(round(math.degrees(angle), 2))


@dataclass(frozen=True)
class _Task:
    """One receiver of the printed chain: its start and slot, and the guides A (L0) and B (the slot before)."""

    start: complex
    target: complex
    b_name: str
    b: complex

    def routes(self) -> list[TwoStepRoute]:
        """Both models, the shorter (eq. 24) first."""
        both = [model(self.start, self.target, 0j, self.b) for model in (model_1, model_2)]
        return sorted(both, key=lambda route: route.length_m)

    def passage(self, route: TwoStepRoute) -> Passage:
        """How near the route passes to the nearer of its guides."""
        legs = ((self.start, route.turning_point), (route.turning_point, self.target))
        distances_m = {
            name: min(float(distance_to_segment(*leg, at)) for leg in legs)
            for name, at in (("L0", 0j), (self.b_name, self.b))
        }
        nearest = min(distances_m, key=lambda name: distances_m[name])
        return Passage(route.model, nearest, distances_m[nearest])


def _tasks(table: LengthTable) -> Iterator[_Task]:
    b_name, b = "L1", _TRANSMITTERS["L1"]
    for row, target in zip(table.rows, circle(len(table.rows), _RADIUS_M).values(), strict=True):
        yield _Task(_point(row.start), target, b_name, b)
        b_name, b = row.receiver, target


def _plan(table: LengthTable, min_separation_m: float) -> RelayPlan:
    return METHODS["paper"](
        RelayProblem(
            transmitters=_TRANSMITTERS,
            receivers={row.receiver: _point(row.start) for row in table.rows},
            slots=circle(len(table.rows), _RADIUS_M),
            min_separation_m=min_separation_m,
        )
    )


def _total(printed: float, lengths: Iterable[float]) -> Comparison:
    """Return the sum beside the printed total, which is the sum of printed, and so rounded, lengths."""
    summands = list(lengths)
    return Comparison(printed, sum(summands), tolerance=ROUNDING_M * (len(summands) + 1))


def _lengths(table: LengthTable) -> LengthsResult:
    tasks = list(_tasks(table))
    rows: list[LengthResult] = []
    for row, task in zip(table.rows, tasks, strict=True):
        shorter, longer = task.routes()
        rows.append(
            LengthResult(
                receiver=row.receiver,
                length=Comparison(row.two_step, shorter.length_m, misprint_for=row.misprint_for),
                geometric_m=row.geometric,
                straight_line_m=abs(task.target - task.start),
                passages=(task.passage(shorter), task.passage(longer)),
            )
        )
    column = sum(row.two_step if row.misprint_for is None else row.misprint_for for row in table.rows)
    return LengthsResult(
        rows=tuple(rows),
        two_step=_total(table.two_step_total, (row.length.recomputed for row in rows)),
        two_step_column=Comparison(table.two_step_total, column, tolerance=ROUNDING_M),
        geometric_column=Comparison(
            table.geometric_total, sum(row.geometric for row in table.rows), tolerance=ROUNDING_M
        ),
        slots_off_m=max(abs(_point(row.slot) - task.target) for row, task in zip(table.rows, tasks, strict=True)),
        plan=_plan(table, min_separation_m=0.0),
    )


def _models(table: ModelTable, lengths: LengthTable) -> ModelsTable:
    rows: list[ModelsResult] = []
    for row, task in zip(table.rows, _tasks(lengths), strict=True):
        chosen, other = task.routes()
        first, second = sorted((chosen, other), key=lambda route: route.model)
        rows.append(
            ModelsResult(
                receiver=row.receiver,
                chosen=chosen.model,
                model_1=_legs(row.model_1, first),
                model_2=_legs(row.model_2, second),
                two_step=_legs(row.two_step, chosen),
            )
        )
    return ModelsTable(
        rows=tuple(rows),
        model_1=_total(table.model_1_total, (row.model_1.total.recomputed for row in rows)),
        model_2=_total(table.model_2_total, (row.model_2.total.recomputed for row in rows)),
        two_step=_total(table.two_step_total, (row.two_step.total.recomputed for row in rows)),
    )


def _legs(printed: Legs, route: TwoStepRoute) -> LegsComparison:
    return LegsComparison(
        Comparison(printed.total, route.length_m),
        Comparison(printed.first, abs(route.s_1_m)),
        Comparison(printed.second, abs(route.s_2_m)),
    )
