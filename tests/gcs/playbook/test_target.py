"""What changes in a playbook with what it is flown on."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.playbook.schema import LONGEST_PATIENCE_S
from gcs.playbook.target import patient
from tests.gcs.simulate.small import small


@pytest.mark.parametrize(
    ("give_up_s", "speedup", "patience_s"),
    [(2.0, 1.0, 2.0), (5.0, 2.0, 5.0), (2.0, 8.0, 12.0), (5.0, 8.0, 12.0), (5.0, 100.0, LONGEST_PATIENCE_S)],
)
def test_faster_than_life_patience_outlasts_a_stall_of_the_machine(
    tmp_path: Path, give_up_s: float, speedup: float, patience_s: float
) -> None:
    playbook = small(tmp_path, give_up_s=give_up_s)
    flown = patient(playbook, speedup)
    assert flown.flight.give_up_s == patience_s
    assert flown.model_copy(update={"flight": playbook.flight}) == playbook
