"""Locating by bearings from the nose: who is switched on for it, and reports between which the nose yaws."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from gcs.bearings import Observation
from gcs.relay.locating import locate, transmitters_to_hear
from planner.angles import wrap
from planner.errors import PositioningError
from planner.positioning import Fix

STANDING = {"L0": 0j, "L1": 100 + 0j, "U1": 50 + 90j}
EXACT = dict.fromkeys(STANDING, 0.0)
PLACE = 30 + 40j
SURE = np.eye(2)


def reports(names: tuple[str, ...] = tuple(STANDING), count: int = 10, yaw_deg: float = 3.0) -> list[Observation]:
    """Exact reports from one place, the nose at 2 rad and yawing."""
    noses_rad = [2.0 + math.radians(yaw_deg) * math.sin(k) for k in range(count)]
    return [
        Observation(
            float(k),
            {name: wrap(cmath.phase(STANDING[name] - PLACE) - nose_rad) for name in names},
            dict.fromkeys(names, 0.002),
            "body",
        )
        for k, nose_rad in enumerate(noses_rad)
    ]


def located(observations: list[Observation], *names: str, prior: complex = PLACE + 0.5, sure: bool = True) -> Fix:
    places = {name: STANDING[name] for name in names or STANDING}
    return locate(observations, places, EXACT, prior, SURE if sure else None, heading_referenced=False)


def test_it_takes_three_to_tell_a_place() -> None:
    assert transmitters_to_hear(40 + 50j, ["L0", "L1"], STANDING, heading_referenced=False) == STANDING.keys()
    assert transmitters_to_hear(40 + 50j, ["L0", "L1"], STANDING, heading_referenced=True) == {"L0", "L1"}


def test_where_two_are_all_that_stand_two_are_heard() -> None:
    two = {"L0": 0j, "L1": 100 + 0j}
    assert transmitters_to_hear(40 + 50j, ["L0"], two, heading_referenced=False) == {"L0", "L1"}


def test_a_third_on_the_same_circle_is_left_silent() -> None:
    on_circle = STANDING | {"U1": 50 + cmath.rect(50.0, 1.0)}
    place = 50 + cmath.rect(50.0, 2.0)
    assert transmitters_to_hear(place, ["L0", "L1"], on_circle, heading_referenced=False) == {"L0", "L1"}


@pytest.mark.parametrize("yaw_deg", [0.0, 3.0, 100.0])
def test_a_nose_that_yaws_between_reports_costs_nothing(yaw_deg: float) -> None:
    assert abs(located(reports(yaw_deg=yaw_deg), sure=False).position - PLACE) < 1e-6


@pytest.mark.parametrize("liar", STANDING)
@pytest.mark.parametrize("jump_deg", [10.0, 45.0, 180.0])
def test_wild_reports_do_not_count_even_the_first(liar: str, jump_deg: float) -> None:
    observations = reports()
    for observation in observations[:3]:
        observation.directions_rad[liar] += math.radians(jump_deg)
    assert abs(located(observations, sure=False).position - PLACE) < 1e-6


def test_reports_that_lack_one_still_help() -> None:
    observations = reports()
    for k, observation in enumerate(observations):
        observation.directions_rad.pop(list(STANDING)[k % 3])
    observations += reports(count=5)
    assert abs(located(observations, sure=False).position - PLACE) < 1e-6


def test_two_need_to_know_where_it_was_expected() -> None:
    observations = reports(("L0", "L1"))
    fix = located(observations, "L0", "L1")
    assert abs(fix.position - PLACE) < 1.0
    assert np.linalg.eigvalsh(fix.covariance)[-1] == pytest.approx(1.0, abs=0.05)
    with pytest.raises(PositioningError, match="three transmitters"):
        located(observations, "L0", "L1", sure=False)


def test_from_north_the_expected_place_is_a_hint_and_no_more() -> None:
    observations = [
        Observation(0.0, {name: cmath.phase(at - PLACE) for name, at in STANDING.items()}, dict.fromkeys(STANDING, 0.1))
    ] * 10
    hinted = locate(observations, STANDING, EXACT, PLACE + 5.0, np.eye(2) * 1e-6)
    assert abs(hinted.position - PLACE) < 1e-6
