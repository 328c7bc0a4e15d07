"""A leg followed by bearings from the nose, which points anywhere: it ends as well, and the nose is found again."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from gcs.stop_monitor import SLOT, ArrivalRule, StopMonitor
from planner.angles import wrap
from planner.plan import Leg
from tests.gcs.test_stop_monitor import LEGS, PLACES, Flight


class Nosed(Flight):
    """A receiver that measures from its nose, and whose start is known to half a metre."""

    nose_rad = 2.5

    def __init__(self, leg: Leg, sigma_deg: float, seed: int, rule: ArrivalRule = SLOT, start: complex | None = None):
        super().__init__(leg, sigma_deg, seed, rule, start)
        covariance = np.eye(2) * 0.25
        self.monitor = StopMonitor(leg, PLACES, leg.start, covariance, self.time_s, rule, heading_referenced=False)

    def directions(self) -> dict[str, float]:
        return {name: wrap(direction - self.nose_rad) for name, direction in super().directions().items()}


def without(directions: dict[str, float], *names: str) -> dict[str, float]:
    return {name: direction for name, direction in directions.items() if name not in names}


@pytest.mark.parametrize("nose_rad", [0.0, 2.5, math.pi])
@pytest.mark.parametrize("leg", LEGS.values(), ids=LEGS.keys())
def test_a_leg_ends_in_its_place_wherever_the_nose_points(leg: Leg, nose_rad: float) -> None:
    flight = Nosed(leg, 0.02, 1)
    flight.nose_rad = nose_rad
    assert flight.fly() < 0.3


def test_the_same_bearings_taken_from_north_end_nowhere() -> None:
    leg = LEGS["away"]
    flight = Nosed(leg, 0.02, 1)
    flight.monitor = StopMonitor(leg, PLACES, leg.start, np.eye(2) * 0.25, flight.time_s, SLOT)
    assert not flight.observe(flight.directions())
    assert not flight.observe(flight.directions())


@pytest.mark.parametrize("seed", range(4))
def test_a_start_that_is_off_is_noticed_along_the_way(seed: int) -> None:
    """The nose keeps pointing where it did: what the bearings turn by tells where the line really is."""
    leg = LEGS["away"]
    assert Nosed(leg, 0.1, seed, start=leg.start + 0.6 - 0.5j).fly() < 0.5


def test_two_transmitters_leave_what_they_cannot_tell_unsure() -> None:
    """Hovering, two give one angle: along their circle the place stays as unsure as it was."""
    leg = LEGS["away"]
    flight = Nosed(leg, 0.02, 2)
    for _ in range(50):
        assert flight.observe(without(flight.directions(), "U7")) == {"L0", "L1"}
        flight.time_s += 0.1
    well, hardly = np.linalg.eigvalsh(flight.monitor.standing_place()[1])
    assert well < 0.03
    assert hardly > 0.2


@pytest.mark.parametrize("turned_deg", [5.0, 40.0, 180.0])
def test_a_nose_that_turns_is_found_again(turned_deg: float) -> None:
    flight = Nosed(LEGS["away"], 0.1, 3)
    for _ in range(20):
        flight.step()
    flight.nose_rad += math.radians(turned_deg)
    lost = sum(len(flight.observe(flight.directions())) < 2 for _ in range(10))
    assert 0 < lost < 6
    assert flight.fly() < 0.7


@pytest.mark.parametrize("jump_deg", [10.0, 45.0, 180.0])
@pytest.mark.parametrize("liar", PLACES)
def test_the_first_report_may_lie(liar: str, jump_deg: float) -> None:
    flight = Nosed(LEGS["away"], 0.1, 4)
    lie = flight.directions()
    lie[liar] = wrap(lie[liar] + math.radians(jump_deg))
    assert liar not in flight.observe(lie)
    assert flight.fly() < 0.6


@pytest.mark.parametrize("jump_deg", [10.0, 45.0, 180.0])
def test_of_two_transmitters_neither_is_believed_before_they_agree(jump_deg: float) -> None:
    flight = Nosed(LEGS["away"], 0.1, 5)
    lie = without(flight.directions(), "U7")
    lie["L0"] = wrap(lie["L0"] + math.radians(jump_deg))
    assert len(flight.observe(lie)) < 2
    assert flight.observe(without(flight.directions(), "U7")) == {"L0", "L1"}
    place, _ = flight.monitor.standing_place()
    assert abs(place - flight.place) < 0.5


def test_one_direction_tells_nothing_before_the_nose_is_known_and_something_after() -> None:
    flight = Nosed(LEGS["away"], 0.1, 6)
    for alone in ({}, without(flight.directions(), "L1", "U7")):
        assert not flight.observe(alone)
    assert flight.observe(flight.directions()) == PLACES.keys()
    assert flight.observe(without(flight.directions(), "L1", "U7")) == {"L0"}
    assert flight.observe({}) == frozenset()
    assert flight.observe(flight.directions()) == PLACES.keys()


def test_only_differences_count() -> None:
    """However the nose points, the filter follows the same way."""
    places = []
    for nose_rad in (0.0, 1.0):
        flight = Nosed(LEGS["away"], 0.1, 7)
        flight.nose_rad = nose_rad
        for _ in range(30):
            flight.step()
        places.append(flight.monitor.place()[0])
    assert cmath.isclose(*places, abs_tol=1e-6)
