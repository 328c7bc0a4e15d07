"""The golden record of the fault campaign: a thousand runs, no violation; and a few of them end as they did then."""

from __future__ import annotations

import json

import pytest

from gcs.faults.fault import KINDS
from gcs.faults.findings import INVARIANTS
from gcs.faults.outcome import fly_with_faults
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from tests.gcs.faults.golden import COMMAND, GOLDEN, PLAYBOOK, SEEDS, told

RECORD = json.loads(GOLDEN.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def playbook() -> Playbook:
    return load_playbook(PLAYBOOK)


def test_a_thousand_runs_found_no_violation() -> None:
    assert RECORD["command"] == COMMAND
    assert (RECORD["runs"], RECORD["first_seed"], RECORD["violations"]) == (1000, 0, [])
    assert RECORD["by_invariant"] == dict.fromkeys(INVARIANTS, 0)


def test_every_fault_there_is_has_struck_in_it() -> None:
    assert RECORD["by_fault"].keys() == set(KINDS)
    assert all(of_kind["runs"] > 5 for of_kind in RECORD["by_fault"].values())


def test_no_lie_told_in_mid_leg_was_believed() -> None:
    assert RECORD["doubted_placements"] == 0


@pytest.mark.parametrize("seed", SEEDS)
def test_a_seed_flies_as_it_did_then(playbook: Playbook, seed: int) -> None:
    (then,) = (run for run in RECORD["some"] if run["seed"] == seed)
    assert told(fly_with_faults(playbook, playbook.plan(), seed)) == then
