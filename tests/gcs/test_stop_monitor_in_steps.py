"""A sensor that shows whole degrees: legs fly without a break, end as well as its steps allow, and it may get stuck."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from gcs.relay.repetition import STEPS_UNCHANGED
from planner.angles import wrap
from tests.gcs.test_stop_monitor import LEGS, LIMITS, PERIOD_S, PLACES, Flight


class InSteps(Flight):
    """A receiver whose sensor rounds what it measures, and can get stuck."""

    def __init__(self, leg: str, sigma_deg: float, seed: int, step_deg: float = 1.0) -> None:
        super().__init__(LEGS[leg], sigma_deg, seed)
        self.step_rad = math.radians(step_deg)
        self.stuck_at: complex | None = None
        self._shown: dict[str, float] = {}
        self.unused = 0
        """Reports that were not flown on."""

    def directions(self) -> dict[str, float]:
        if self.stuck_at is None:
            measured = super().directions()
            self._shown = {name: wrap(round(at / self.step_rad) * self.step_rad) for name, at in measured.items()}
        return dict(self._shown)

    def observe(self, directions: dict[str, float]) -> frozenset[str]:
        sigma_rad = dict.fromkeys(PLACES, max(self.sigma_rad, 1e-4))
        agreeing = self.monitor.observe(self.time_s, directions, sigma_rad, self.step_rad)
        self.unused += len(agreeing) < 2
        return agreeing

    def off_sigmas(self) -> float:
        """How far the receiver is from where its monitor has it, in standard deviations."""
        place, covariance = self.monitor.place()
        off = np.array([(place - self.place).real, (place - self.place).imag])
        return math.sqrt(float(off @ np.linalg.solve(covariance, off)))


FLOWN = [name for name in LEGS if name != "no length at all"]


@pytest.mark.parametrize("sigma_deg", [0.02, 0.5])
@pytest.mark.parametrize("leg", FLOWN)
def test_a_leg_is_flown_without_a_break_and_ends_as_well_as_if_nothing_was_rounded(leg: str, sigma_deg: float) -> None:
    """Under way every step is passed at a moment that is known, and half a degree across 100 m would be 0.9 m."""
    flight = InSteps(leg, sigma_deg, 1)
    assert flight.fly(limit_s=30.0) < 0.5
    assert not flight.unused


@pytest.mark.parametrize("sigma_deg", [0.02, 0.3])
def test_it_is_known_how_well_the_end_is_known(sigma_deg: float) -> None:
    """Rounding taken for noise like any other puts it seven standard deviations off, as sure as it is then."""
    off = []
    for leg in FLOWN:
        flight = InSteps(leg, sigma_deg, 1)
        flight.fly()
        off.append(flight.off_sigmas())
    assert max(off) < 3.5
    assert np.mean(np.square(off)) / 2.0 < 1.5


def test_a_step_much_smaller_than_the_noise_changes_next_to_nothing() -> None:
    rounded, plain = InSteps("away", 0.2, 3, step_deg=0.01), Flight(LEGS["away"], 0.2, 3)
    assert abs(rounded.fly() - plain.fly()) < 0.1


def stuck_in_mid_leg(leg: str, step_deg: float) -> InSteps:
    """Return a flight whose sensor has got stuck, just when that was found."""
    flight = InSteps(leg, 0.02, 2, step_deg)
    for _ in range(25):
        assert not flight.step()
    flight.stuck_at = flight.place
    while not flight.monitor.stuck:
        assert flight.time_s < 1030.0
        flight.step()
    return flight


@pytest.mark.parametrize("leg", FLOWN)
@pytest.mark.parametrize("step_deg", [0.2, 1.0])
def test_one_that_gets_stuck_is_found_before_a_direction_has_turned_by_much_more_than_steps_explain(
    leg: str, step_deg: float
) -> None:
    """What is beyond one and a half steps is flown until the next report."""
    flight = stuck_in_mid_leg(leg, step_deg)
    assert flight.stuck_at is not None
    turned_rad = [abs(cmath.phase((at - flight.place) / (at - flight.stuck_at))) for at in PLACES.values()]
    longest_m = 2.0 * PERIOD_S * LIMITS.speed_mps
    nearest_m = min(abs(at - flight.place) for at in PLACES.values())
    assert max(turned_rad) < STEPS_UNCHANGED * flight.step_rad + longest_m / nearest_m


def test_a_stuck_one_is_not_flown_on_from_where_it_was_stopped_until_it_shows_something_else() -> None:
    flight = stuck_in_mid_leg("away", 1.0)
    flight.command = 0j
    flight.monitor.commanded(flight.time_s, 0j)
    for _ in range(30):
        assert not flight.observe(flight.directions())
        flight.move()
    assert flight.monitor.stuck
    flight.stuck_at = None
    assert flight.fly() < 0.5
    assert not flight.monitor.stuck
