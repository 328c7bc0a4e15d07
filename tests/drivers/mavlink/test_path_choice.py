"""The first preferred link on which a vehicle is heard: left soon, returned to late, never to and fro."""

import itertools
import random

import pytest

from drivers.mavlink.path_choice import PATIENCE_S, RETURN_AFTER_S, SILENT_S, STEADY_S, Path, better_path

END_S = 60.0


class Choice:
    """Plays what is heard on each link, as it comes, and keeps which link was in use when."""

    def __init__(self, links=2):
        self.paths = [Path(number, None) for number in range(links)]
        self.used = self.paths[0]
        self.changes = []

    def look(self, now_s):
        better = better_path(self.paths, self.used, now_s)
        if better is not None:
            self.used = better
            self.changes.append((now_s, better.number))

    def play(self, *heard_on):
        """Hear at the times given for each link; setpoints give the occasion to look ten times a second."""
        happenings = [(time_s, number) for number, times in enumerate(heard_on) for time_s in times]
        happenings += [(0.1 * tenth, None) for tenth in range(int(END_S * 10))]
        for time_s, number in sorted(happenings, key=lambda at: (at[0], at[1] is None)):
            if number is not None:
                self.paths[number].hear(time_s)
            self.look(time_s)
        return self.changes


def every(period_s, begin_s=0.0, end_s=END_S):
    return [begin_s + period_s * number for number in range(round((end_s - begin_s) / period_s))]


@pytest.fixture
def choice():
    return Choice()


def test_nothing_is_changed_while_the_preferred_link_is_heard_or_nobody_is(choice):
    assert choice.play(every(0.2), every(0.2)) == []
    assert Choice().play([], []) == []


@pytest.mark.parametrize("period_s", [0.1, 0.2])
def test_a_link_that_falls_silent_is_left_within_a_third_of_a_second_of_its_last_word(choice, period_s):
    ((changed_s, number), *_) = choice.play(every(period_s, end_s=20.0), every(period_s, begin_s=0.07))
    assert number == 1
    assert SILENT_S < changed_s - (20.0 - period_s) < 0.37


def test_a_link_that_comes_back_is_returned_to_when_it_has_been_steady_for_a_while(choice):
    heard = every(0.2, end_s=10.0) + every(0.2, begin_s=20.0)
    (_, _), (returned_s, number) = choice.play(heard, every(0.2))
    assert number == 0
    assert 20.0 + RETURN_AFTER_S <= returned_s < 20.0 + RETURN_AFTER_S + 0.5


def test_a_link_that_comes_and_goes_is_not_returned_to(choice):
    heard = every(0.2, end_s=10.0) + [t for t in every(0.2, begin_s=10.0) if t % 4.0 < 3.0]
    assert [number for _, number in choice.play(heard, every(0.2))] == [1]


def test_a_link_returned_to_is_left_as_soon_as_at_first(choice):
    heard = every(0.2, end_s=10.0) + every(0.2, begin_s=20.0, end_s=40.0)
    times = [time_s for time_s, number in choice.play(heard, every(0.2)) if number == 1]
    assert times == pytest.approx([10.1, 40.1], abs=0.1)


def test_heartbeats_alone_are_no_reason_to_change_to_and_fro(choice):
    assert choice.play(every(1.0), every(1.0, begin_s=0.5)) == []


def test_a_link_with_heartbeats_alone_is_left_when_several_are_missing_and_returned_to(choice):
    heard = every(1.0, end_s=10.0) + every(1.0, begin_s=30.0)
    (left_s, first), (returned_s, second) = choice.play(heard, every(1.0, begin_s=0.5))
    assert (first, second) == (1, 0)
    assert PATIENCE_S < left_s - 9.0 < PATIENCE_S + 1.0
    assert 30.0 + RETURN_AFTER_S <= returned_s < 30.0 + RETURN_AFTER_S + 1.0


def test_the_only_link_that_is_heard_is_used_from_the_beginning(choice):
    ((changed_s, number),) = choice.play([], every(1.0, begin_s=5.0))
    assert (changed_s, number) == (5.0, 1)


def test_a_link_heard_only_just_now_is_not_changed_to_for_one_missing_position(choice):
    heard = [t for t in every(0.2) if not 5.9 < t < 6.3]
    assert choice.play(heard, every(0.2, begin_s=6.05 - STEADY_S / 2)) == []


def test_of_three_links_the_first_good_one_is_used():
    changes = Choice(3).play(every(0.2, end_s=10.0), every(0.2, end_s=20.0), every(0.2))
    assert [number for _, number in changes] == [1, 2]


def test_lossy_links_are_not_changed_more_often_than_they_fall_silent(choice):
    """One in ten messages is lost on each link, at random: each loss is a silence."""
    lossy = random.Random(7)
    heard = [[t + begin for t in every(0.2) if lossy.random() > 0.1] for begin in (0.0, 0.1)]
    changes = choice.play(*heard)
    silences = sum(later - earlier > SILENT_S for times in heard for earlier, later in itertools.pairwise(times))
    assert 2 <= len(changes) < silences
    assert all(later - earlier > SILENT_S for (earlier, _), (later, _) in itertools.pairwise(changes))
