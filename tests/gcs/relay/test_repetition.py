"""A sensor with steps may repeat itself until a direction must have turned by one; one that goes on is stuck."""

from __future__ import annotations

import cmath
import math

import pytest

from gcs.relay.repetition import STEPS_UNCHANGED, Repetition

PLACES = {"L0": 0j, "L1": 100 + 0j}
SHOWN = {"L0": 1.0, "L1": 2.0}
DEGREE = math.radians(1.0)


def turned(degrees: float) -> complex:
    """Return where L0's direction has turned by so much, and L1's by less, since 50 + 50j."""
    return (50 + 50j) * cmath.exp(1j * math.radians(degrees))


@pytest.fixture
def repetition() -> Repetition:
    noted = Repetition(PLACES)
    noted.begin()
    noted.note(SHOWN, DEGREE, turned(0.0), under_way=True)
    assert not noted.stuck
    return noted


def test_a_sensor_without_steps_repeats_nothing_under_way(repetition: Repetition) -> None:
    repetition.note(dict(SHOWN), 0.0, turned(0.0), under_way=False)
    assert not repetition.stuck
    repetition.note(dict(SHOWN), 0.0, turned(0.0), under_way=True)
    assert repetition.stuck
    repetition.note(dict(SHOWN), 0.0, turned(0.0), under_way=False)
    assert not repetition.stuck


def test_one_with_steps_is_given_one_and_a_half_of_them(repetition: Repetition) -> None:
    for tenth in range(1, 15):
        repetition.note(dict(SHOWN), DEGREE, turned(tenth / 10), under_way=True)
        assert not repetition.stuck
    repetition.note(dict(SHOWN), DEGREE, turned(STEPS_UNCHANGED + 0.01), under_way=True)
    assert repetition.stuck


def test_one_direction_that_changes_shows_that_it_is_not_stuck(repetition: Repetition) -> None:
    for degrees in range(1, 20):
        repetition.note({"L0": 1.0, "L1": 2.0 + DEGREE * degrees}, DEGREE, turned(degrees), under_way=True)
        assert not repetition.stuck


def test_found_stuck_it_stays_so_at_a_stand_still_until_it_shows_something_else(repetition: Repetition) -> None:
    repetition.note(dict(SHOWN), DEGREE, turned(2.0), under_way=True)
    for _ in range(50):
        repetition.note(dict(SHOWN), DEGREE, turned(2.0), under_way=False)
        assert repetition.stuck
    repetition.note({"L0": 1.0, "L1": 2.0 + DEGREE}, DEGREE, turned(2.0), under_way=False)
    assert not repetition.stuck


def test_begun_anew_it_is_given_another_chance(repetition: Repetition) -> None:
    repetition.note(dict(SHOWN), DEGREE, turned(2.0), under_way=True)
    repetition.begin()
    repetition.note(dict(SHOWN), DEGREE, turned(2.0), under_way=True)
    assert not repetition.stuck
    repetition.note(dict(SHOWN), DEGREE, turned(4.0), under_way=True)
    assert repetition.stuck


def test_what_is_flown_against_a_drift_turns_no_direction(repetition: Repetition) -> None:
    for tenth in range(100):
        repetition.note(dict(SHOWN), DEGREE, turned(tenth / 10), under_way=False)
    repetition.note(dict(SHOWN), DEGREE, turned(10.2), under_way=True)
    assert not repetition.stuck


def test_one_direction_alone_tells_nothing() -> None:
    repetition = Repetition(PLACES)
    for degrees in range(10):
        repetition.note({"L0": 1.0}, DEGREE, turned(degrees), under_way=True)
        assert not repetition.stuck
