"""Separation looks ahead by the way it takes to stop, and keeps apart who was stopped for it."""

from __future__ import annotations

import pytest

from gcs.guidance import SpeedLimits, leg_velocity
from gcs.relay.leg_filter import Whereabouts
from gcs.separation import Keeping, braking_way, nearest_m


@pytest.mark.parametrize(("speed_mps", "stops_in_m"), [(0.0, 0.0), (3.0, 3.0), (5.0, 7.0)])
def test_a_copter_that_is_told_to_stop_runs_on(speed_mps: float, stops_in_m: float) -> None:
    """ArduCopter's defaults: 3.0 m from 3 m/s and 7.0 m from 5 m/s; what it told is up to 0.6 s old."""
    way = braking_way(-1j * speed_mps)
    assert way.real == pytest.approx(0.0)
    assert stops_in_m <= -way.imag <= stops_in_m + 0.61 * speed_mps


def test_nobody_who_ends_a_leg_as_planned_is_taken_to_run_over_its_end() -> None:
    for to_fly_m in (0.05, 0.3, 1.0, 2.0, 3.0, 6.0, 20.0):  # from where it would come to rest
        now = Whereabouts(0.0, complex(-to_fly_m), complex(-to_fly_m), 0j, 0j, 0.1, 0.1)
        speed_mps = leg_velocity(now, SpeedLimits(speed_mps=8.0)).real
        comes_to_rest_after_m = speed_mps**2 / 5.0 + 0.4 * speed_mps
        assert abs(braking_way(complex(speed_mps))) < to_fly_m + comes_to_rest_after_m


@pytest.mark.parametrize(
    ("apart", "closing", "nearest"),
    [
        (10 + 0j, 0j, 10.0),
        (10 + 0j, -4 + 0j, 6.0),
        (10 + 0j, 4 + 0j, 10.0),  # they part
        (10 + 0j, -20 + 0j, 0.0),  # they meet on the way
        (10 + 3j, -20 + 0j, 3.0),  # they pass by each other
    ],
)
def test_the_nearest_on_the_way(apart: complex, closing: complex, nearest: float) -> None:
    assert nearest_m(apart, closing) == pytest.approx(nearest)


def test_who_came_too_near_is_kept_until_they_are_apart_again() -> None:
    keeping = Keeping(longest_s=6.0)
    assert keeping.still_from("U1", 0.0, lambda _: 4.0) is None
    keeping.note("U1", "U2", 10.0, 4.6)
    keeping.note("U1", "U2", 10.1, 4.3)
    assert keeping.still_from("U1", 11.0, lambda _: 4.3) == "U2"
    assert keeping.still_from("U1", 12.0, lambda _: 4.7) == "U2"
    assert keeping.still_from("U2", 12.0, lambda _: 4.7) is None
    assert keeping.still_from("U1", 13.0, lambda _: 4.9) is None
    assert keeping.still_from("U1", 13.1, lambda _: 4.3) is None, "parted, they are not kept any more"


def test_nobody_is_kept_for_ever() -> None:
    keeping = Keeping(longest_s=6.0)
    keeping.note("U1", "U2", 10.0, 4.3)
    assert keeping.still_from("U1", 16.0, lambda _: 4.3) == "U2"
    assert keeping.still_from("U1", 16.1, lambda _: 4.3) is None
