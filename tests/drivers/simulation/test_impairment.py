"""A bad radio does to packets what it is told, in the share it is told, and the same again for the same seed."""

from __future__ import annotations

import random

import pytest

from drivers.simulation.impairment import UNIMPAIRED, Impairment

PACKETS = 2000


def arrivals(impairment: Impairment, seed: int = 1) -> list[list[float]]:
    draws = random.Random(seed)
    return [impairment.arrivals_s(draws) for _ in range(PACKETS)]


def test_what_nothing_is_wrong_with_arrives_once_and_at_once() -> None:
    assert arrivals(UNIMPAIRED) == [[0.0]] * PACKETS


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_the_share_that_gets_lost_is_the_share_that_it_was_told(share: float) -> None:
    lost = sum(not copies for copies in arrivals(Impairment(loss=share)))
    assert lost / PACKETS == pytest.approx(share, abs=0.04)
    assert arrivals(Impairment(loss=1.0)) == [[]] * PACKETS


def test_what_is_doubled_comes_twice_and_the_second_time_no_sooner() -> None:
    doubled = arrivals(Impairment(duplication=1.0))
    assert all(len(copies) == 2 and 0.0 == copies[0] <= copies[1] < 1.0 for copies in doubled)


def test_what_is_delayed_comes_within_its_delay_and_jitter() -> None:
    late = [copies[0] for copies in arrivals(Impairment(delay_s=0.5, jitter_s=0.2))]
    assert 0.5 <= min(late) < 0.51
    assert 0.69 < max(late) <= 0.7


def test_what_is_held_back_is_overtaken_by_the_next_of_a_stream_of_ten_a_second() -> None:
    held_back = [copies[0] for copies in arrivals(Impairment(reordering=0.3)) if copies[0] > 0.0]
    assert len(held_back) / PACKETS == pytest.approx(0.3, abs=0.04)
    assert min(held_back) > 0.1


def test_a_seed_repeats_it_and_another_does_not() -> None:
    everything = Impairment(0.2, 0.3, 0.2, 0.1, 0.1)
    assert arrivals(everything, 7) == arrivals(everything, 7)
    assert arrivals(everything, 7) != arrivals(everything, 8)
