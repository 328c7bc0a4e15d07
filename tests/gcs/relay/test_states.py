"""The relay's transition table: what it allows happens, everything else is an error naming both states."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.errors import IllegalTransitionError
from gcs.relay.states import ENDED, IN_FLIGHT, TRANSITIONS, ReceiverState, require_transition

states = st.sampled_from(ReceiverState)


@given(states, states)
def test_only_what_stands_in_the_table_is_allowed(old: ReceiverState, new: ReceiverState) -> None:
    if new in TRANSITIONS[old]:
        require_transition("U1", old, new)
    else:
        with pytest.raises(IllegalTransitionError, match=f"U1: {old.value} -> {new.value}"):
            require_transition("U1", old, new)


def test_the_way_of_a_receiver() -> None:
    way = ["WAITING", "LOCATING", "LEG_1", "LEG_2", "VERIFYING", "TRIMMING", "VERIFYING", "PLACED"]
    for old, new in pairwise(way):
        require_transition("U1", ReceiverState(old), ReceiverState(new))


def test_every_state_is_in_the_table_and_can_be_held() -> None:
    assert TRANSITIONS.keys() == set(ReceiverState)
    for state in IN_FLIGHT:
        assert {ReceiverState.HELD, ReceiverState.PILOT, ReceiverState.FAILED} <= TRANSITIONS[state]


def test_whoever_was_held_is_located_before_anything_else_and_a_pilot_s_is_held_before_it_flies() -> None:
    assert TRANSITIONS[ReceiverState.HELD] & (IN_FLIGHT | ENDED) == {ReceiverState.LOCATING, ReceiverState.FAILED}
    assert TRANSITIONS[ReceiverState.PILOT] == {ReceiverState.HELD, ReceiverState.FAILED}


def test_whoever_was_trimmed_is_verified_again() -> None:
    assert TRANSITIONS[ReceiverState.TRIMMING] & (IN_FLIGHT | ENDED) == {ReceiverState.VERIFYING, ReceiverState.FAILED}


def test_failed_is_the_end() -> None:
    assert not TRANSITIONS[ReceiverState.FAILED]


def test_only_legs_are_ever_skipped() -> None:
    """A route may have fewer than two legs; everybody is located before and verified after."""
    stages = ["WAITING", "LOCATING", "LEG_1", "LEG_2", "VERIFYING", "PLACED"]
    for number, stage in enumerate(stages[:-1]):
        onward = {state.value for state in TRANSITIONS[ReceiverState(stage)]} & set(stages)
        skipped = {name for later in onward for name in stages[number + 1 : stages.index(later)]}
        assert skipped <= {"LEG_1", "LEG_2"}
        assert all(stages.index(later) > number for later in onward)
