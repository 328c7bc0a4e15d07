"""What counts as a fresh bearing, and what is known from those heard last."""

from __future__ import annotations

import math

import pytest

from drivers.bus.messages import Bearing, BearingReport
from gcs.faults.hearing import Hearing


def report(*azimuths_deg: float) -> BearingReport:
    bearings = [Bearing(f"L{number}", math.radians(at), 0.01) for number, at in enumerate(azimuths_deg)]
    return BearingReport(0, 0, "true_north", bearings)


@pytest.fixture
def heard() -> Hearing:
    hearing = Hearing(oldest_s=0.5)
    hearing.take(10.0, 9.9, report(10, 20))
    return hearing


def test_a_young_report_is_fresh(heard: Hearing) -> None:
    assert heard.fresh_s == 10.0
    heard.take(10.1, 10.0, report(11, 20))
    assert heard.fresh_s == 10.1


@pytest.mark.parametrize(
    ("captured_s", "azimuths_deg"),
    [(9.9, (11, 21)), (9.8, (11, 21)), (10.0, ())],
    ids=["the same instant again", "overtaken", "nothing heard"],
)
def test_what_is_no_news_is_not_fresh(heard: Hearing, captured_s: float, azimuths_deg: tuple[float, ...]) -> None:
    heard.take(10.1, captured_s, report(*azimuths_deg))
    assert heard.fresh_s == 10.0


def test_what_repeats_itself_once_may_be_news_and_twice_is_a_stuck_sensor(heard: Hearing) -> None:
    heard.take(10.1, 10.0, report(10, 20))
    assert heard.fresh_s == 10.1
    heard.take(10.2, 10.1, report(10, 20))
    heard.take(10.3, 10.2, report(10, 20))
    assert heard.fresh_s == 10.1
    heard.take(10.4, 10.3, report(10.1, 20))
    assert heard.fresh_s == 10.4


def test_what_was_long_on_its_way_is_not_fresh(heard: Hearing) -> None:
    heard.take(11.0, 10.4, report(11, 21))
    assert heard.fresh_s == 10.0


def test_bearings_that_pass_by_a_place_are_known_to() -> None:
    hearing = Hearing(oldest_s=0.5)
    for number in range(20):
        hearing.take(number * 0.1, number * 0.1, report(0.1 * (-1) ** number, 90.0 + 0.01 * number))
    transmitters = {"L0": 100 + 0j, "L1": 100j}
    assert hearing.farthest_off_m(0j, transmitters, math.radians(0.1))[0] < 0.2
    off_m, name = hearing.farthest_off_m(6j, transmitters, math.radians(0.1))
    assert (off_m, name) == (pytest.approx(6.0, abs=0.2), "L0")
    assert hearing.farthest_off_m(6j, {"L9": 1j}, 0.01) is None
