"""Guidance commands no more than the limits allow, and nothing that leads away from where the leg ends."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.guidance import AT_THE_END_M, SpeedLimits, leg_velocity
from gcs.relay.leg_filter import Whereabouts

LIMITS = SpeedLimits()


def at(seen: complex, at_rest: complex, drift: complex = 0j) -> Whereabouts:
    return Whereabouts(0.0, seen, at_rest, 0j, drift, sigma_m=0.1, sway_m=0.1)


def points(size: float) -> st.SearchStrategy[complex]:
    return st.complex_numbers(max_magnitude=size, allow_nan=False, allow_infinity=False)


@given(points(200.0), points(200.0), points(10.0), st.floats(0.5, 10.0))
def test_no_command_is_faster_than_the_limit(seen: complex, at_rest: complex, drift: complex, speed: float) -> None:
    assert abs(leg_velocity(at(seen, at_rest, drift), SpeedLimits(speed_mps=speed))) <= speed + 1e-9


@given(points(200.0), points(200.0))
def test_nothing_leads_away_from_the_end_or_the_line(seen: complex, at_rest: complex) -> None:
    velocity = leg_velocity(at(seen, at_rest), LIMITS)
    for speed_mps, off_m in ((velocity.real, seen.real), (velocity.imag, seen.imag)):
        assert speed_mps * off_m <= 0.0 or abs(off_m) <= AT_THE_END_M


@settings(max_examples=30)
@given(st.floats(0.5, 80.0))
def test_the_taper_leaves_room_to_stop(remaining_m: float) -> None:
    """From the commanded speed the vehicle stops, at its full deceleration, before the end."""
    along_mps = leg_velocity(at(complex(-remaining_m), complex(-remaining_m)), LIMITS).real
    assert along_mps > 0.0
    assert along_mps**2 / (2 * LIMITS.deceleration_mps2) <= remaining_m


def test_one_that_will_come_to_rest_at_the_end_is_left_to_it() -> None:
    assert leg_velocity(at(seen=-4.0 + 0j, at_rest=0.5 + 0j), LIMITS) == 0j


def test_an_overshoot_is_crept_back() -> None:
    assert -0.3 < leg_velocity(at(seen=0.2 + 0j, at_rest=0.2 + 0j), LIMITS).real < 0.0


def test_a_steady_drift_is_flown_against_up_to_a_limit() -> None:
    assert leg_velocity(at(0j, 0j, drift=0.1 - 0.2j), LIMITS) == pytest.approx(-0.1 + 0.2j)
    fast = leg_velocity(at(0j, 0j, drift=5.0 - 5.0j), LIMITS)
    assert abs(fast) == pytest.approx(math.sqrt(2.0) * LIMITS.drift_mps)
