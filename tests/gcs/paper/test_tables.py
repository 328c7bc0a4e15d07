"""What the paper prints, against what the planner makes of the printed starts."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs.paper.chain import one_model_plan
from gcs.paper.comparison import Comparison
from gcs.paper.printed import PRINTED
from gcs.paper.tables import recompute


@pytest.fixture(scope="module")
def paper():
    return recompute(PRINTED)


def test_the_whole_paper_holds(paper):
    assert paper.holds


@pytest.mark.parametrize("model", ["model_1", "model_2", "two_step"])
def test_every_length_of_table_6_is_within_a_hundredth_of_print(paper, model):
    for row in paper.table_6.rows:
        legs = getattr(row, model)
        for part in (legs.first, legs.second, legs.total):
            assert abs(part.difference) < 0.01, row.receiver


def test_the_two_step_choice_of_table_6(paper):
    assert [row.chosen for row in paper.table_6.rows] == ["I"] * 3 + ["II"] * 5


def test_totals_of_table_6(paper):
    totals = (paper.table_6.model_1, paper.table_6.model_2, paper.table_6.two_step)
    assert [round(total.recomputed, 2) for total in totals] == [616.50, 571.27, 491.59]


def test_every_row_of_table_4_is_within_a_hundredth_of_print(paper):
    assert len(paper.table_4.rows) == 20
    assert all(abs(row.length.difference) < 0.01 for row in paper.table_4.rows)


def test_only_u6_of_table_3_is_a_misprint_and_its_correction_is_table_6s(paper):
    off = [row for row in paper.table_3.rows if abs(row.length.difference) > 0.01]
    assert [row.receiver for row in off] == ["U6"]
    assert off[0].length.printed == 45.34
    assert off[0].length.misprint_for == PRINTED.table_6.rows[5].two_step.total == 42.74
    assert off[0].length.holds


def test_quoted_lengths_shorter_than_the_straight_line(paper):
    assert [row.receiver for row in paper.table_3.rows if row.quoted_too_short] == ["U2", "U4"]
    assert [row.receiver for row in paper.table_4.rows if row.quoted_too_short] == ["U17"]


def test_printed_routes_that_come_nearer_than_the_separation_to_a_guide(paper):
    assert not [row for row in paper.table_3.rows if row.passages[0].distance_m < 5.0]
    near = {row.receiver: row.passages for row in paper.table_4.rows if row.passages[0].distance_m < 5.0}
    assert list(near) == ["U1", "U6", "U14"]
    flown, other = near["U1"]
    assert (flown.model, flown.guide, other.model, other.guide) == ("I", "L1", "II", "L0")
    assert max(flown.distance_m, other.distance_m) < 1e-9
    assert near["U6"][0].distance_m == pytest.approx(2.38, abs=0.01)
    assert near["U14"][0].distance_m == pytest.approx(4.04, abs=0.01)


@pytest.mark.parametrize(("table", "total_m", "bound_m"), [("table_3", 491.59, 364.18), ("table_4", 830.42, 687.00)])
def test_the_planner_assigns_the_identity_at_the_printed_total(paper, table, total_m, bound_m):
    result = getattr(paper, table)
    assert result.assignment_is_identity
    assert [route.slot for route in result.plan.routes] == [f"O{k}" for k in range(1, len(result.rows) + 1)]
    assert result.plan.total_length_m == pytest.approx(total_m, abs=0.005)
    assert result.plan.total_length_m == pytest.approx(result.two_step.recomputed, abs=1e-9)
    assert result.plan.straight_line_bound_m == pytest.approx(bound_m, abs=0.005)


def test_the_flyable_chain_costs_more_and_shifts_sixteen_receivers(paper):
    slots = {route.receiver: route.slot for route in paper.flyable.routes}
    shifted = {"U1": "O16"} | {f"U{k}": f"O{k - 1}" for k in range(2, 17)} | {f"U{k}": f"O{k}" for k in range(17, 21)}
    assert slots == shifted
    assert paper.flyable.total_length_m == pytest.approx(951.32, abs=0.005)


def test_table_2_from_exact_and_from_rounded_angles(paper):
    assert len(paper.table_2) == 7
    for row in paper.table_2:
        assert row.exact_m < 1e-9
        assert 1e-5 < row.rounded_m < 0.007
        assert row.printed_estimate_m == pytest.approx(row.printed.error_radius, abs=6e-5)


def test_table_2_counts_the_positions_that_fit_the_unsigned_angles(paper):
    fits = {row.printed.name: row.candidates for row in paper.table_2}
    assert fits["Bottom right"] == 4
    assert all(1 <= count <= 4 for count in fits.values())


def test_printed_columns_sum_to_their_totals():
    for table in (PRINTED.table_3, PRINTED.table_4):
        assert math.isclose(sum(row.geometric for row in table.rows), table.geometric_total, abs_tol=1e-9)
        column = sum(row.misprint_for or row.two_step for row in table.rows)
        assert math.isclose(column, table.two_step_total, abs_tol=1e-9)
    assert PRINTED.table_5[0].total == PRINTED.table_3.geometric_total
    assert PRINTED.table_5[1].total == PRINTED.table_3.two_step_total


@pytest.mark.parametrize(("off", "holds"), [(0.0299, True), (-0.0299, True), (0.0301, False), (-0.0301, False)])
def test_a_row_holds_up_to_three_hundredths(off, holds):
    assert Comparison(printed=50.0 + off, recomputed=50.0).holds is holds


def test_a_misprint_is_judged_by_its_correction():
    misprint = Comparison(printed=45.34, recomputed=42.74, misprint_for=42.74)
    assert misprint.holds
    assert not replace(misprint, recomputed=45.34).holds


@pytest.mark.parametrize(("table", "total_m", "mean_steps"), [("table_3", 494.57, 10.25), ("table_4", 1414.51, 20.35)])
def test_the_reconstructed_descents_all_arrive_and_do_not_reproduce_print(paper, table, total_m, mean_steps):
    result = getattr(paper, table)
    for row in result.rows:
        assert row.geometric_here.converged, row.receiver
        assert row.geometric_here.length_m > row.straight_line_m - 0.02, row.receiver
    assert result.geometric_here_m == pytest.approx(total_m, abs=0.5)
    assert result.mean_steps == pytest.approx(mean_steps, abs=0.5)
    assert result.geometric_here_m < 0.8 * result.geometric_column.printed


def test_trilateration_is_exact_from_exact_angles(paper):
    for row in paper.table_2:
        assert row.trilateration_exact_m < 1e-9
        assert 1e-5 < row.trilateration_rounded_m < 0.007


@pytest.mark.parametrize(("index", "total_m"), [(0, 616.50), (1, 571.27)])
def test_the_plan_of_one_model_has_its_total_in_table_6(index, total_m):
    plan = one_model_plan(PRINTED.table_3, index)
    assert plan.total_length_m == pytest.approx(total_m, abs=0.005)
    assert {route.model for route in plan.routes} == {("I", "II")[index]}
    assert [route.slot for route in plan.routes] == [f"O{k}" for k in range(1, 9)]
