"""Who stands in its slot, and who is worth a trim leg."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import HoldRequiredError
from gcs.relay.placing import require_in_slot, worth_trimming
from planner.plan import Route
from planner.positioning import Fix

SLOT = 70 + 60j
ROUTE = Route("U1", "O1", 0, 0, "general", 0j, SLOT, ())
SURE, ROUGH = np.eye(2) * 0.1**2, np.eye(2) * 1.0**2


def fix(off: complex, covariance: np.ndarray = SURE) -> Fix:
    return Fix(SLOT + off, covariance, 0.001, ("L0", "L1"), ())


@pytest.mark.parametrize(("off", "covariance"), [(0j, SURE), (3.2 + 0j, SURE), (-5.9j, ROUGH)])
def test_who_may_be_within_the_tolerance_stands_there(off: complex, covariance: np.ndarray) -> None:
    require_in_slot(ROUTE, fix(off, covariance), SLOT + off, covariance, 3.0, disbelieved=False)


@pytest.mark.parametrize(
    ("heard", "place", "covariance", "disbelieved", "words"),
    [
        (3.4 + 0j, 0j, SURE, False, r"^bearings put it 3.4 m from O1 \(allowed are 3.3 m\)$"),
        (0j, 3.4j, SURE, False, "its last leg and bearings put it 3.4 m from O1"),
        (0j, 0j, SURE, True, "cannot have flown to"),
        (0j, 0j, np.diag([0.01, 9.1]), False, "not known to 3 m whether it stands in O1"),
    ],
)
def test_who_is_off_or_unknown_is_held(
    heard: complex, place: complex, covariance: np.ndarray, disbelieved: bool, words: str
) -> None:
    with pytest.raises(HoldRequiredError, match=words):
        require_in_slot(ROUTE, fix(heard), SLOT + place, covariance, 3.0, disbelieved=disbelieved)


def test_only_what_is_known_better_than_it_is_small_is_trimmed() -> None:
    assert worth_trimming(0.4 + 0j, SURE)
    assert not worth_trimming(0.2 + 0j, SURE)
    assert not worth_trimming(1.4 + 0j, ROUGH)
    assert worth_trimming(1.6 + 0j, ROUGH)
