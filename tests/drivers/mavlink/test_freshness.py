"""State that a slow way tells late does not undo what a prompt one told; a restarted autopilot is believed at once."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.freshness import Freshness, Verdict

HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3)
FRESH, REPEATED, LATE = Verdict.FRESH, Verdict.REPEATED, Verdict.LATE


def position(time_s):
    return mavlink.MAVLink_global_position_int_message(round(time_s * 1000), 0, 0, 0, 0, 0, 0, 0, 0)


class Autopilot:
    """Tells its time on two ways, each as late as it is."""

    def __init__(self):
        self.freshness = Freshness(2)
        self.now_s = 1000.0
        self.switched_on_s = 900.0
        self.lag_s = [0.0, 0.0]

    def tell(self, way, lag_s=None):
        lag_s = self.lag_s[way] if lag_s is None else lag_s
        return self.freshness.verdict(way, position(self.now_s - lag_s - self.switched_on_s), self.now_s)

    def beat(self, way):
        return self.freshness.verdict(way, HEARTBEAT, self.now_s)


@pytest.fixture
def autopilot():
    return Autopilot()


def test_of_two_prompt_ways_the_quicker_brings_the_news_and_the_other_repeats_them(autopilot):
    for _ in range(20):
        autopilot.now_s += 0.2
        told_s = autopilot.now_s - autopilot.switched_on_s
        assert autopilot.freshness.verdict(0, position(told_s), autopilot.now_s) is FRESH
        assert autopilot.freshness.verdict(1, position(told_s), autopilot.now_s + 0.1) is REPEATED
        assert autopilot.beat(0) is autopilot.beat(1) is FRESH


def test_a_message_lost_on_the_quicker_way_comes_on_the_other(autopilot):
    assert autopilot.tell(0) is FRESH
    autopilot.now_s += 0.2
    assert autopilot.tell(1, lag_s=0.1) is FRESH


def test_what_a_way_tells_late_is_late_with_a_time_on_it_or_without(autopilot):
    autopilot.lag_s[1] = 3.0
    for _ in range(20):
        autopilot.now_s += 0.2
        assert autopilot.tell(0) is FRESH
        assert autopilot.beat(0) is FRESH
        assert autopilot.tell(1) is LATE
        assert autopilot.beat(1) is LATE


def test_of_a_way_that_stalled_nothing_is_believed_until_it_has_proved_itself_again(autopilot):
    """What waited in it may come out heartbeat first."""
    for _ in range(5):
        autopilot.now_s += 0.2
        autopilot.tell(0)
        autopilot.tell(1)
    for _ in range(20):
        autopilot.now_s += 0.2
        autopilot.tell(0)
    assert autopilot.beat(1) is LATE
    assert autopilot.tell(1, lag_s=4.0) is LATE
    assert autopilot.beat(1) is LATE
    assert autopilot.tell(1, lag_s=0.0) is REPEATED
    assert autopilot.beat(1) is FRESH


def test_the_only_way_left_is_believed_however_late(autopilot):
    autopilot.lag_s[1] = 3.0
    autopilot.tell(0)
    assert autopilot.tell(1) is LATE
    autopilot.now_s += 1.5
    assert autopilot.beat(1) is FRESH
    autopilot.now_s += 3.0
    assert autopilot.tell(1) is FRESH


def test_without_any_times_everything_is_believed(autopilot):
    for way in (0, 1, 1, 0):
        autopilot.now_s += 1.0
        assert autopilot.beat(way) is FRESH


@pytest.mark.parametrize("first", [0, 1])
def test_a_restart_is_believed_from_whichever_way_tells_it_first_and_the_old_life_is_over(autopilot, first):
    other = 1 - first
    autopilot.lag_s[other] = 0.4
    for _ in range(10):
        autopilot.now_s += 0.2
        autopilot.tell(0)
        autopilot.tell(1)
    before = autopilot.switched_on_s
    autopilot.switched_on_s = autopilot.now_s
    autopilot.now_s += 2.0
    assert autopilot.tell(first) is FRESH
    after, autopilot.switched_on_s = autopilot.switched_on_s, before
    assert autopilot.tell(other, lag_s=2.2) is LATE, "said before the restart"
    assert autopilot.beat(other) is LATE
    autopilot.switched_on_s = after
    for _ in range(30):
        autopilot.now_s += 0.2
        assert autopilot.tell(first) is FRESH
        assert autopilot.tell(other) is REPEATED
        assert autopilot.beat(other) is FRESH


def test_after_a_restart_the_way_that_told_of_it_is_believed_without_times_while_the_other_tells_of_the_old_life(
    autopilot,
):
    """Restarted, an autopilot sends nothing but heartbeats until it is asked for more."""
    autopilot.lag_s[1] = 5.0
    for _ in range(60):
        autopilot.now_s += 0.2
        autopilot.tell(0)
        autopilot.tell(1)
    before, autopilot.switched_on_s = autopilot.switched_on_s, autopilot.now_s
    autopilot.now_s += 2.0
    assert autopilot.tell(0) is FRESH
    autopilot.switched_on_s = before
    for _ in range(10):
        autopilot.now_s += 0.2
        assert autopilot.tell(1) is LATE
        assert autopilot.beat(0) is FRESH


def test_a_restart_that_the_slow_way_tells_after_the_prompt_one_is_no_second_restart(autopilot):
    autopilot.lag_s[1] = 5.0
    for _ in range(60):
        autopilot.now_s += 0.2
        autopilot.tell(0)
        autopilot.tell(1)
    before, restarted_s = autopilot.switched_on_s, autopilot.now_s
    for _ in range(100):
        autopilot.now_s += 0.2
        autopilot.switched_on_s = restarted_s
        assert autopilot.tell(0) is FRESH
        assert autopilot.beat(0) is FRESH
        if autopilot.now_s - 5.0 < restarted_s:
            autopilot.switched_on_s = before
        assert autopilot.tell(1) is LATE


def test_a_way_that_was_away_during_a_restart_is_believed_when_it_comes_back(autopilot):
    autopilot.tell(0)
    autopilot.tell(1)
    autopilot.switched_on_s = autopilot.now_s
    for _ in range(200):
        autopilot.now_s += 0.2
        autopilot.tell(0)
    assert autopilot.tell(1) is REPEATED
    assert autopilot.beat(1) is FRESH


def test_a_restart_soon_after_another_may_be_missed_by_a_way_and_it_is_believed_all_the_same(autopilot):
    """Its clock never went back, as far as this way tells."""
    autopilot.switched_on_s = autopilot.now_s
    autopilot.now_s += 3.0
    autopilot.tell(0)
    autopilot.tell(1)
    autopilot.switched_on_s = autopilot.now_s
    for _ in range(40):
        autopilot.now_s += 0.1
        autopilot.tell(0)
    assert autopilot.tell(1) is REPEATED
    assert autopilot.beat(1) is FRESH


def test_an_autopilot_that_tells_no_time_in_its_timed_messages_is_heard(autopilot):
    for way in (0, 1, 0, 0):
        autopilot.now_s += 0.2
        assert autopilot.freshness.verdict(way, position(0.0), autopilot.now_s) is FRESH


@given(st.lists(st.tuples(st.integers(0, 1), st.floats(0.0, 1.0), st.floats(0.0, 20.0)), max_size=80))
def test_the_position_that_is_taken_never_goes_back_in_time(happenings):
    """Each way keeps the order, as queues do, but is as late as it likes."""
    autopilot, told, taken_s = Autopilot(), [0.0, 0.0], 0.0
    for way, passed_s, lag_s in happenings:
        autopilot.now_s += passed_s
        told[way] = max(told[way], autopilot.now_s - lag_s - autopilot.switched_on_s)
        if autopilot.freshness.verdict(way, position(told[way]), autopilot.now_s) is FRESH:
            assert round(told[way], 3) > taken_s or taken_s == 0.0
            taken_s = round(told[way], 3)
