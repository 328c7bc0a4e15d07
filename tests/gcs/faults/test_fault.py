"""Faults are drawn the same for the same seed, of every kind, and each within what its kind may be."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.faults.fault import AMOUNTS, KINDS, Fault, draw_faults
from gcs.faults.striking import FOR_ALL, stop_within_s
from planner.plan import RelayPlan
from tests.gcs.simulate.small import small


@pytest.fixture
def plan(tmp_path: Path) -> RelayPlan:
    return small(tmp_path, two=True).plan()


def drawn(plan: RelayPlan) -> list[Fault]:
    return [fault for seed in range(400) for fault in draw_faults(plan, seed)]


def test_a_seed_draws_the_same_again_and_another_does_not(plan: RelayPlan) -> None:
    assert draw_faults(plan, 3) == draw_faults(plan, 3)
    assert draw_faults(plan, 3) != draw_faults(plan, 4)


def test_every_kind_is_drawn_for_ever_and_for_a_while_and_sometimes_two_at_once(plan: RelayPlan) -> None:
    assert {fault.kind for fault in drawn(plan)} == set(KINDS)
    assert {fault.for_s is None for fault in drawn(plan)} == {True, False}
    assert {len(draw_faults(plan, seed)) for seed in range(50)} == {1, 2}


def test_amounts_are_within_what_their_kinds_may_be(plan: RelayPlan) -> None:
    for fault in drawn(plan):
        if (amount := AMOUNTS.get(fault.kind)) is not None:
            assert amount.low * 0.999 <= abs(fault.amount) <= amount.high * 1.001
            assert fault.amount > 0.0 or amount.signed


def test_targets_are_transmitters_of_the_route_or_its_receiver(plan: RelayPlan) -> None:
    for fault in drawn(plan):
        of_a_transmitter = fault.kind in ("transmitter_drift", "transmitter_silent", "pilot_transmitter")
        known = plan.route_of(fault.at.receiver).transmitters if of_a_transmitter else (fault.at.receiver,)
        assert fault.target in known


def test_a_router_is_started_anew_in_some_time_and_all_must_stop_until_then(plan: RelayPlan) -> None:
    of_its_kind = [fault for fault in drawn(plan) if fault.kind == "router_restarted"]
    assert of_its_kind
    assert all(fault.for_s is not None for fault in of_its_kind)
    assert "router_restarted" in FOR_ALL
    assert stop_within_s(of_its_kind[0], (), 0.5, done=False, cut=False, from_north=True) == pytest.approx(0.7)
