"""A system is answered where its autopilot speaks from; nobody else can draw its setpoints away."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Codec
from drivers.mavlink.transports.peers import CONTESTED_S, MOST_BYSTANDERS, STICKS_S, Peers

HERE, THERE, ELSEWHERE = ("10.0.0.1", 14550), ("10.0.0.2", 14550), ("10.0.0.3", 9999)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3)
POSITION = mavlink.MAVLink_global_position_int_message(1, 2, 3, 4, 5, 6, 7, 8, 9)
GROUND_STATION = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


class Airfield:
    """Peers that hear what passes their own check, as a socket's do."""

    def __init__(self):
        self.peers = Peers()

    def say(self, source, now_s, message=HEARTBEAT, system_id=1, component_id=1):
        frame = bytearray(Codec(system_id, component_id).encode(message))
        admitted = self.peers.admits(frame, source, now_s)
        if admitted:
            self.peers.heard(frame, source, now_s)
        return admitted

    def answered(self, system_id=1):
        return set(self.peers.of(system_id))


@pytest.fixture
def field():
    return Airfield()


def test_nobody_is_answered_before_anybody_spoke(field):
    assert field.answered(0) == field.answered(1) == set()


def test_each_of_several_vehicles_is_answered_at_its_own_address_and_all_are_told_what_is_for_all(field):
    field.say(HERE, 0.0, system_id=1)
    field.say(THERE, 0.0, system_id=2)
    field.say(THERE, 0.1, system_id=3)
    assert (field.answered(1), field.answered(2), field.answered(3)) == ({HERE}, {THERE}, {THERE})
    assert field.answered(0) == {HERE, THERE}


def test_a_system_whose_autopilot_has_not_said_what_it_is_is_looked_for_everywhere(field):
    field.say(HERE, 0.0, system_id=1)
    field.say(THERE, 0.0, POSITION, system_id=2)
    assert field.answered(2) == {HERE, THERE}


def test_a_stranger_with_the_same_system_id_is_refused_while_the_vehicle_is_heard(field):
    field.say(HERE, 0.0)
    for tenth in range(1, 200):
        now_s = tenth * 0.1
        field.say(HERE, now_s, POSITION)
        assert not field.say(ELSEWHERE, now_s + 0.05)
        assert not field.say(ELSEWHERE, now_s + 0.06, POSITION)
        assert field.answered() == {HERE}


def test_a_vehicle_that_moved_to_another_address_is_answered_there_after_some_seconds_of_silence(field):
    field.say(HERE, 0.0)
    assert not field.say(THERE, STICKS_S - 0.1)
    assert field.say(THERE, STICKS_S + 0.1)
    assert field.answered() == {THERE}
    assert HERE not in field.answered(0)
    assert not field.say(HERE, STICKS_S + 0.2)


def test_only_a_heartbeat_of_an_autopilot_makes_an_address_the_vehicles(field):
    field.say(HERE, 0.0)
    late_s = STICKS_S + 1.0
    for message, component_id in (
        (POSITION, 1),
        (GROUND_STATION, 1),
        (HEARTBEAT, mavlink.MAV_COMP_ID_GIMBAL),
        (HEARTBEAT, 190),
    ):
        field.say(ELSEWHERE, late_s, message, component_id=component_id)
        assert field.answered() == {HERE}


def test_other_components_of_a_system_may_speak_from_anywhere(field):
    field.say(HERE, 0.0)
    assert field.say(ELSEWHERE, 0.1, component_id=mavlink.MAV_COMP_ID_GIMBAL)
    assert field.answered() == {HERE}


def test_two_autopilots_with_one_system_id_are_told_of_as_long_as_both_speak(field):
    for second in range(4):
        field.say(HERE, second + 0.0)
        field.say(THERE, second + 0.5)
    assert field.peers.contested(4.0) == {1}
    for second in range(4, 20):
        field.say(HERE, second + 0.0)
    assert field.peers.contested(4.0 + CONTESTED_S + 4.0) == frozenset()


def test_a_vehicle_that_only_moved_is_not_contested(field):
    field.say(HERE, 0.0)
    for second in range(1, 9):
        field.say(THERE, float(second))
        assert field.peers.contested(float(second)) == frozenset()


def test_a_crowd_without_an_autopilot_does_not_make_heartbeats_go_to_ever_more_addresses(field):
    field.say(HERE, 0.0)
    for number in range(1000):
        field.say(("10.1.0.1", number), 0.0, GROUND_STATION, system_id=255, component_id=190)
    assert len(field.answered(0)) == 1 + MOST_BYSTANDERS
    assert HERE in field.answered(0)
    field.say(THERE, 1.0, system_id=2)
    assert THERE in field.answered(0)


def test_a_heartbeat_cut_short_before_it_says_which_autopilot_is_none_and_harms_nothing(field, frame_of):
    frame = frame_of(0, b"\x04")
    assert field.peers.admits(frame, HERE, 0.0)
    field.peers.heard(frame, HERE, 0.0)
    assert field.answered(1) == {HERE}, "as a bystander"
    field.say(THERE, 0.1)
    assert field.answered(1) == {THERE}


happenings = st.lists(
    st.tuples(
        st.sampled_from([HERE, THERE, ELSEWHERE]),
        st.floats(0.0, 2.0),
        st.sampled_from([HEARTBEAT, HEARTBEAT, POSITION, GROUND_STATION]),
        st.integers(1, 2),
        st.sampled_from([1, 1, 154]),
    ),
    max_size=60,
)


@given(happenings)
def test_whatever_is_heard_the_address_of_a_vehicle_that_speaks_does_not_change(events):
    field, now_s, spoke = Airfield(), 0.0, {}
    for source, passed_s, message, system_id, component_id in events:
        now_s += passed_s
        routes = {known: field.answered(known) for known in spoke}
        admitted = field.say(source, now_s, message, system_id, component_id)
        for known, (at, last_s) in spoke.items():
            if now_s - last_s <= STICKS_S:
                assert field.answered(known) == routes[known] == {at}
        if component_id == 1:
            at, last_s = spoke.get(system_id, (source, -100.0))
            if at != source:
                assert admitted == (now_s - last_s > STICKS_S)
            if (at == source and system_id in spoke) or (admitted and message is HEARTBEAT):
                spoke[system_id] = (source, now_s)
