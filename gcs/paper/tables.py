"""Recomputes the paper's tables 2 to 6 with the planner and sets every number beside the printed one."""

from __future__ import annotations

import math
from collections.abc import Iterable

from gcs.paper.chain import problem, tasks
from gcs.paper.comparison import (
    ROUNDING_M,
    Comparison,
    LegsComparison,
    LengthResult,
    LengthsResult,
    ModelsResult,
    ModelsTable,
    PaperComparison,
    PositioningResult,
)
from gcs.paper.places import point, receiver, triangle
from gcs.paper.printed import Legs, LengthTable, ModelTable, Positioning, PositioningCase, PrintedPaper
from planner.baselines import trilateration, trilateration_angles
from planner.methods import METHODS
from planner.positioning import two_circle, two_circle_candidates
from planner.routes import TwoStepRoute

FLYABLE_SEPARATION_M = 5.0


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
        flyable=METHODS["paper"](problem(printed.table_4, FLYABLE_SEPARATION_M)),
    )


def _positioning(setting: Positioning, case: PositioningCase) -> PositioningResult:
    corners, true = triangle(setting), receiver(setting, case)
    exact = trilateration_angles(true, *corners)
    alpha, beta, gamma = (_rounded(angle) for angle in exact)
    return PositioningResult(
        printed=case,
        exact_m=abs(complex(two_circle(*exact[:2], *corners).position) - true),
        rounded_m=abs(complex(two_circle(alpha, beta, *corners).position) - true),
        trilateration_exact_m=abs(trilateration(*exact, *corners) - true),
        trilateration_rounded_m=abs(trilateration(alpha, beta, gamma, *corners) - true),
        printed_estimate_m=abs(point(case.estimate) - point(case.position)),
        candidates=len(two_circle_candidates(abs(exact[0]), abs(exact[1]), *corners)),
    )


def _rounded(angle: float) -> float:
    """Return the angle rounded to 0.01 degree, rad."""
    return math.radians(round(math.degrees(angle), 2))


def _total(printed: float, lengths: Iterable[float]) -> Comparison:
    """Return the sum beside the printed total, which is the sum of printed, and so rounded, lengths."""
    summands = list(lengths)
    return Comparison(printed, sum(summands), tolerance=ROUNDING_M * (len(summands) + 1))


def _lengths(table: LengthTable) -> LengthsResult:
    chain = list(tasks(table))
    rows: list[LengthResult] = []
    for row, task in zip(table.rows, chain, strict=True):
        shorter, longer = sorted(task.models(), key=lambda route: route.length_m)
        rows.append(
            LengthResult(
                receiver=row.receiver,
                length=Comparison(row.two_step, shorter.length_m, misprint_for=row.misprint_for),
                geometric_m=row.geometric,
                geometric_here=task.descent(),
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
        slots_off_m=max(abs(point(row.slot) - task.target) for row, task in zip(table.rows, chain, strict=True)),
        plan=METHODS["paper"](problem(table, min_separation_m=0.0)),
    )


def _models(table: ModelTable, lengths: LengthTable) -> ModelsTable:
    rows: list[ModelsResult] = []
    for row, task in zip(table.rows, tasks(lengths), strict=True):
        first, second = task.models()
        chosen = min(first, second, key=lambda route: route.length_m)
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
