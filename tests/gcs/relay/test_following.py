"""A vehicle that does not come where it was told to fly is noticed in seconds, and no other is taken for one."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gcs.relay.following import OVER_S, Following
from tests.gcs.test_stop_monitor import LEGS, Flight

PERIOD_S = 0.1


def watched(
    commanded: Callable[[float], complex], found: Callable[[float], complex], for_s: float, sigma_m: float = 0.2
) -> float | None:
    """Return when a vehicle was found not to follow, or None."""
    following = Following()
    for number in range(round(for_s / PERIOD_S)):
        time_s = number * PERIOD_S
        following.note(100.0 + time_s, commanded(time_s), found(time_s), sigma_m)
        if following.lost:
            return time_s
    return None


def test_one_that_flies_as_told_follows() -> None:
    assert watched(lambda at_s: 5 * at_s, lambda at_s: 5 * at_s, 30.0) is None


def test_one_that_comes_a_little_late_and_is_blown_aside_follows() -> None:
    assert watched(lambda at_s: 5 * at_s, lambda at_s: 4 * at_s + 1j * at_s, 30.0) is None


@pytest.mark.parametrize("going_mps", [0.0, 1.0, -3.0, 3j])
def test_one_that_flies_otherwise_does_not(going_mps: complex) -> None:
    lost_s = watched(lambda at_s: 5 * at_s, lambda at_s: going_mps * at_s, 30.0)
    assert lost_s is not None
    assert OVER_S <= lost_s < OVER_S + 0.5


def test_one_that_stops_obeying_in_mid_leg_does_not() -> None:
    lost_s = watched(lambda at_s: 5 * at_s, lambda at_s: 5 * min(at_s, 10.0), 30.0)
    assert lost_s is not None
    assert 12.0 < lost_s < 10.0 + OVER_S


def test_one_that_is_told_to_stand_follows_wherever_it_drifts() -> None:
    assert watched(lambda _: 3 + 0j, lambda at_s: 0.5 * at_s, 30.0) is None


def test_what_bearings_cannot_tell_is_not_held_against_it() -> None:
    assert watched(lambda at_s: 0.15 * at_s, lambda _: 0j, 30.0, sigma_m=0.2) is None
    assert watched(lambda at_s: 5 * at_s, lambda _: 0j, 30.0, sigma_m=10.0) is None


def test_one_that_answers_the_slowest_velocities_by_drifting_is_not_judged() -> None:
    """As PX4 does at the end of a leg."""
    assert watched(lambda at_s: 0.45 * at_s, lambda at_s: -0.1 * at_s, 30.0, sigma_m=0.05) is None


def test_one_that_flew_well_and_then_creeps_is_not_judged() -> None:
    """As PX4 did on a leg of 5 m: told to slow down from 1.5 to 0.4 m/s, it stood, half of its way short."""
    slows_s = 3.0
    assert (
        watched(
            lambda at_s: 1.5 * min(at_s, slows_s) + 0.4 * max(0.0, at_s - slows_s),
            lambda at_s: 1.5 * min(at_s, slows_s),
            30.0,
            sigma_m=0.05,
        )
        is None
    )


def test_one_that_flew_on_beyond_its_end_does_not_follow_however_slowly_it_is_called_back() -> None:
    """As one does whose link was cut before it slowed down."""
    turns_s = 3.0
    lost_s = watched(
        lambda at_s: 2.0 * min(at_s, turns_s) - 0.35 * max(0.0, at_s - turns_s),
        lambda at_s: 2.0 * min(at_s, turns_s + 1.5),
        30.0,
    )
    assert lost_s is not None
    assert lost_s < turns_s + OVER_S + 1.0


def test_begun_anew_nothing_counts_that_was_before() -> None:
    following = Following()
    for number in range(80):
        following.note(number * PERIOD_S, 5 * number * PERIOD_S + 0j, 0j, 0.2)
    assert following.lost
    following.begin()
    assert not following.lost
    following.note(8.1, 40.5 + 0j, 0j, 0.2)
    assert not following.lost


def test_a_leg_that_is_flown_is_followed_to_its_end() -> None:
    flight = Flight(LEGS["away"], 0.1, 1)
    while not flight.step():
        assert not flight.monitor.unfollowed
