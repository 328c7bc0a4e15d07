"""Verdicts: every figure is read from a report as it stands, and what is not in it is not measured."""

from __future__ import annotations

import pytest

from gcs.expectations import FIGURES, all_passed, judge, measured, parse_condition, verdicts_of
from gcs.expectations.condition import Value
from tests.gcs.expectations.reports import leg, receiver, report


@pytest.mark.parametrize(
    ("figure", "expected"),
    [
        ("outcome", "formed"),
        ("held_reason", ""),
        ("receivers_placed", 3),
        ("receivers_held", 0),
        ("placement_error_m", 0.9),
        ("placement_error_m.min", 0.2),
        ("placement_error_m.median", 0.4),
        ("placement_error_m.mean", 0.5),
        ("placement_error_m.p95", 0.85),
        ("placement_error_m.U2", 0.4),
        ("placement_error_m.U9", None),
        ("hover_error_m", 0.3),
        ("hover_error_m.U2", 0.2),
        ("hover_largest_m", 0.7),
        ("hover_largest_m.U2", None),
        ("stop_error_deg", 0.3),
        ("stop_error_deg.U1", 0.3),
        ("flown_length_m", 240.0),
        ("flown_length_m.U1", 80.0),
        ("planned_length_m", 246.0),
        ("length_ratio", 1.05),
        ("min_separation_m", 7.5),
        ("duration_s", 90.0),
        ("stage_duration_s", 60.0),
        ("stage_duration_s.hold", 5.0),
        ("stage_duration_s.land", None),
        ("stages_failed", 0),
        ("emission_transmitter_s", 120.0),
        ("bearings_received", 900),
        ("bearings_refused", 5),
        ("bearings_refused.stuck", 2),
        ("link_lost_share", 0.1),
        ("link_lost_share.U2", 0.0),
        ("link_lost_share.U3", None),
        ("overshoot_m", None),
        ("outliers", None),
        ("setpoints_after_takeover", None),
    ],
)
def test_each_figure_of_a_report(figure: str, expected: Value | None) -> None:
    found = measured(figure, report())
    assert found == (pytest.approx(expected) if isinstance(expected, float) else expected)


def test_figures_that_only_some_reports_tell() -> None:
    taken = {**receiver("U1", "PILOT"), "setpoints_after_takeover": 2, "overshoot_m": 0.5}
    wild = {**receiver("U2"), "legs": [{**leg(), "outliers": 3}, {**leg(), "outliers": 4}]}
    told = report(taken, wild)
    assert measured("setpoints_after_takeover", told) == 2
    assert measured("setpoints_after_takeover.U2", told) is None
    assert measured("overshoot_m", told) == 0.5
    assert measured("outliers.U2", told) == 7
    assert measured("receivers_pilot", told) == 1


def test_where_a_receiver_stands_counts_as_placement_only_when_it_is_placed() -> None:
    told = report(
        receiver("U1"), receiver("U2", "HELD", 30.0, "no bearing"), receiver("U3", "HELD", None, "no bearing")
    )
    assert measured("placement_error_m", told) == 0.2
    assert measured("placement_error_m.U2", told) is None
    assert measured("slot_distance_m", told) == 30.0
    assert measured("held_reason", told) == "no bearing"
    assert measured("receivers_held", told) == 2


def test_a_stage_asks_for_its_own_duration_and_the_run_for_the_longest() -> None:
    expected = {"stage_duration_s": parse_condition("< 50")}
    assert [verdict.passed for verdict in judge(expected, report(), "hold")] == [True]
    assert [verdict.measured for verdict in judge(expected, report(), "relay")] == [60.0]
    assert [verdict.measured for verdict in judge(expected, report(), "land")] == [None]
    assert [verdict.measured for verdict in judge(expected, report())] == [60.0]


@pytest.mark.parametrize("name", FIGURES)
def test_no_figure_needs_more_than_an_empty_report(name: str) -> None:
    assert measured(name, {}) in (None, 0, "")


def test_verdicts_come_in_order_with_what_was_measured() -> None:
    expected = {"outcome": "formed", "placement_error_m": "< 0.5", "overshoot_m": "< 1", "min_separation_m": "5 .. 9"}
    conditions = {figure: parse_condition(written) for figure, written in expected.items()}
    verdicts = judge(conditions, report(), "relay")
    assert [verdict.passed for verdict in verdicts] == [True, False, False, True]
    assert [str(verdict) for verdict in verdicts] == [
        "relay: outcome formed, expected == formed",
        "relay: placement_error_m 0.9, expected < 0.5",
        "relay: overshoot_m not measured, expected < 1",
        "relay: min_separation_m 7.5, expected 5 .. 9",
    ]
    assert not all_passed(verdicts)
    assert all_passed(verdicts[:1])
    assert all_passed([])
    assert verdicts[1].to_json() == {
        "figure": "placement_error_m", "condition": "< 0.5", "measured": 0.9, "passed": False, "stage": "relay",
    }  # fmt: skip


def test_of_a_stage_that_was_not_reached_nothing_came_true() -> None:
    told = report(stages=[{"name": "hold", "outcome": "not_reached"}, {"name": "relay", "outcome": "failed"}])
    assert measured("stages_failed", told) == 1
    expected = {"outcome": parse_condition("formed")}
    assert [verdict.passed for verdict in judge(expected, told, "relay")] == [True]
    assert [str(verdict) for verdict in judge(expected, told, "hold")] == [
        "hold: outcome not measured, expected == formed"
    ]
    assert all_passed(judge(expected, told))


@pytest.mark.parametrize(
    ("outcome", "stages", "expected"),
    [
        ("formed", ["done", "done"], [True, True, True]),
        ("completed", ["done"], [True, True]),
        ("aborted", ["done"], [True, False]),
        ("formed", ["done", "failed"], [True, False, True]),
    ],
)
def test_a_playbook_that_expects_nothing_expects_its_stages_done(
    outcome: str, stages: list[str], expected: list[bool]
) -> None:
    named = [{"name": f"{number}", "outcome": stage} for number, stage in enumerate(stages)]
    verdicts = verdicts_of({"outcome": outcome, "stages": named, "verdicts": []})
    assert [verdict.passed for verdict in verdicts] == expected


def test_what_a_playbook_expects_alone_decides() -> None:
    told = {"figure": "outcome", "condition": "== aborted", "measured": "aborted", "passed": True, "stage": "relay"}
    [verdict] = verdicts_of({"outcome": "aborted", "stages": [], "verdicts": [told]})
    assert verdict.passed
    assert verdict.to_json() == told
