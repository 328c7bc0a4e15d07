"""A link sends in the right order, hears only who it should, and counts what is lost."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import LinkError
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import Link, Setpoint, Subscription, open_link
from drivers.mavlink.link_status import LinkState
from drivers.mavlink.transport import LinkAddress
from tests.fakes import settle

HEARTBEAT_ID = mavlink.MAVLINK_MSG_ID_HEARTBEAT
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 1, 4, 4, 3)


def setpoint(north_mps, system_id=1, expires_s=float("inf")):
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, system_id, 1, 1, 0x05C7, 0, 0, 0, north_mps, 0, 0, 0, 0, 0, 0, 0
    )
    return Setpoint(message, expires_s, stops=north_mps == 0.0)


def command(number, system_id=1):
    return mavlink.MAVLink_command_long_message(system_id, 1, number, 0, 0, 0, 0, 0, 0, 0, 0)


def brief(message):
    return message.vx if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED" else message.command


@pytest.fixture
def heard(rig):
    """What reaches the handler of system 1, which wants heartbeats only."""
    messages = []
    rig.link.listen(Subscription(1, frozenset({HEARTBEAT_ID}), messages.append))
    return messages


async def test_urgent_leaves_before_setpoints_before_ordinary_whatever_the_order_of_posting(rig):
    rig.link.post(command(10))
    rig.link.post_setpoint(1, setpoint(1.0))
    rig.link.post(command(11))
    rig.link.post_urgent(command(20))
    rig.link.post_urgent(command(21))
    assert rig.wire.messages == [], "only the owner task writes to a link"
    await settle()
    assert [brief(message) for message in rig.wire.messages] == [20, 21, 1.0, 10, 11]


async def test_the_latest_setpoint_replaces_one_still_waiting_for_the_same_vehicle(rig):
    rig.link.post_setpoint(1, setpoint(1.0, 1))
    rig.link.post_setpoint(2, setpoint(5.0, 2))
    rig.link.post_setpoint(1, setpoint(2.0, 1))
    await settle()
    assert sorted((m.target_system, m.vx) for m in rig.wire.messages) == [(1, 2.0), (2, 5.0)]


async def test_every_setpoint_leaves_when_none_has_to_wait(rig):
    for north_mps in (1.0, 2.0, 3.0):
        rig.link.post_setpoint(1, setpoint(north_mps))
        await settle()
    assert [message.vx for message in rig.wire.messages] == [1.0, 2.0, 3.0]


async def test_a_dropped_setpoint_never_leaves_and_the_others_do(rig):
    rig.link.post_setpoint(1, setpoint(1.0, 1))
    rig.link.post_setpoint(2, setpoint(2.0, 2))
    rig.link.drop_setpoint(1)
    rig.link.drop_setpoint(3)
    await settle()
    assert [message.target_system for message in rig.wire.messages] == [2]


async def test_a_stop_leaves_before_the_motion_of_other_vehicles(rig):
    rig.link.post_setpoint(1, setpoint(1.0, 1))
    rig.link.post_setpoint(2, setpoint(2.0, 2))
    rig.link.post_setpoint(3, setpoint(0.0, 3))
    await settle()
    assert [message.vx for message in rig.wire.messages] == [0.0, 1.0, 2.0]


async def test_a_setpoint_that_waited_past_its_time_never_leaves(rig):
    """The event loop stalls between posting and sending, as under load or after a suspend."""
    rig.link.post_setpoint(1, setpoint(1.0, 1, expires_s=rig.clock.now_s() + 0.5))
    rig.link.post_setpoint(2, setpoint(2.0, 2, expires_s=rig.clock.now_s() + 9.0))
    rig.clock.jump(5.0)
    await settle()
    assert [message.vx for message in rig.wire.messages] == [2.0]


async def test_a_message_that_cannot_be_packed_is_said_and_harms_no_other(rig, caplog):
    rig.link.post(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1e300, 0, 0, 0, 0, 0, 0))
    rig.link.post(command(11))
    await settle()
    assert [brief(message) for message in rig.wire.messages] == [11]
    assert "COMMAND_LONG cannot be sent" in caplog.text


async def test_a_heartbeat_of_a_ground_station_leaves_each_second(rig):
    await rig.clock.advance(3.5)
    heartbeats = [sent for sent in rig.wire.sent if sent.message.get_msgId() == HEARTBEAT_ID]
    assert [sent.time_s - 100.0 for sent in heartbeats] == [0.0, 1.0, 2.0, 3.0]
    assert {sent.message.type for sent in heartbeats} == {mavlink.MAV_TYPE_GCS}


async def test_everything_sent_is_numbered_in_one_sequence_and_counted(rig):
    for number in range(300):
        rig.link.post(command(number))
        rig.link.post_setpoint(1, setpoint(float(number)))
        await settle()
    sequence = [sent.message.get_seq() for sent in rig.wire.sent]
    assert sequence == [number % 256 for number in range(len(sequence))]
    assert rig.link.counters.sent == len(sequence)


async def test_only_the_autopilot_of_a_known_system_is_heard(rig, heard):
    rig.speaker(1).heartbeat()
    for stranger in (rig.speaker(1, 191), rig.speaker(1, 0), rig.speaker(2), rig.speaker(255, 190)):
        stranger.heartbeat(mode=9)
    assert [message.custom_mode for message in heard] == [4]
    assert rig.link.counters.received == 5


async def test_only_the_wanted_messages_are_handed_on(rig, heard):
    rig.copter.text("not for you")
    rig.copter.heartbeat()
    assert [message.get_type() for message in heard] == ["HEARTBEAT"]


async def test_a_damaged_frame_is_counted_and_not_handed_on(rig, heard):
    frame = rig.copter.frame(mavlink.MAVLink_heartbeat_message(2, 3, 1, 9, 4, 3))
    frame[12] ^= 0xFF
    rig.link.receive(frame)
    assert heard == []
    assert rig.link.codec.malformed == 1
    rig.copter.heartbeat()
    assert len(heard) == 1


async def test_an_unknown_message_of_a_vehicle_is_ignored(rig, heard, frame_of):
    rig.link.receive(frame_of(0xABCDE, b"??"))
    assert heard == []


@pytest.mark.parametrize(
    ("sequence", "lost"),
    [
        pytest.param([0, 1, 2], 0, id="none missing"),
        pytest.param([7, 8], 0, id="the first frame heard may carry any number"),
        pytest.param([0, 2], 1, id="one missing"),
        pytest.param([0, 5, 10], 8, id="two gaps"),
        pytest.param([254, 255, 0, 1], 0, id="the wrap is no gap"),
        pytest.param([254, 1], 2, id="a gap across the wrap"),
        pytest.param([255, 1], 1, id="zero missing at the wrap"),
        pytest.param([3, 3, 4], 0, id="a frame heard twice"),
        pytest.param([10, 12, 11, 13], 1, id="an older frame coming late is no gap of 254"),
    ],
)
async def test_gaps_in_the_sequence_are_counted_as_lost(rig, sequence, lost):
    for number in sequence:
        rig.copter.sequence = number
        rig.copter.heartbeat()
    assert rig.link.counters.lost == lost


async def test_each_source_has_a_sequence_of_its_own(rig):
    vehicle, gimbal, other = rig.speaker(1), rig.speaker(1, 154), rig.speaker(2)
    for source, start in ((vehicle, 0), (gimbal, 100), (other, 200)):
        source.sequence = start
    for _ in range(4):
        for source in (vehicle, gimbal, other):
            source.heartbeat()
    assert rig.link.counters.lost == 0


async def test_every_message_is_sent_to_the_system_it_is_for(rig):
    rig.link.post(command(10, system_id=3))
    rig.link.post_urgent(command(20, system_id=4))
    rig.link.post_setpoint(5, setpoint(1.0, system_id=5))
    await settle()
    assert [sent.system_id for sent in rig.wire.sent] == [0, 4, 5, 3], "a heartbeat is for all"


async def test_behind_a_backlog_no_motion_is_sent_but_stops_and_commands_are(rig):
    await settle()
    rig.wire.backlogged = True
    rig.link.post_setpoint(1, setpoint(1.0, 1))
    rig.link.post_setpoint(2, setpoint(0.0, 2))
    rig.link.post(command(10))
    rig.link.post_urgent(command(20))
    await settle()
    assert [brief(message) for message in rig.wire.messages] == [20, 0.0, 10]
    assert rig.link.counters.dropped == 1
    rig.wire.backlogged = False
    await settle()
    assert len(rig.wire.messages) == 3, "what was not sent in time is not sent late"


async def test_what_the_transport_does_not_take_is_counted_and_not_as_sent(rig):
    await settle()
    sent = rig.link.counters.sent
    rig.wire.takes = False
    rig.link.post(command(10))
    rig.link.post_setpoint(1, setpoint(1.0))
    await settle()
    assert (rig.link.counters.sent - sent, rig.link.counters.dropped) == (0, 2)


class Taken:
    """A frame log in memory."""

    def __init__(self):
        self.came, self.went = [], []

    def received(self, frame):
        self.came.append(bytes(frame))

    def sent(self, frame):
        self.went.append(bytes(frame))


class Suspicious(Codec):
    """Accepts the frames of system 1 only."""

    def accepts(self, frame):
        return frame[5] == 1


async def test_a_frame_that_is_not_accepted_leaves_no_trace_but_a_count(make_rig, clock):
    log, rig, heard = Taken(), make_rig(clock), []
    rig.link = Link(Suspicious(), clock, log)
    async with rig.running():
        for system_id in (1, 2):
            rig.link.listen(Subscription(system_id, frozenset({HEARTBEAT_ID}), heard.append))
        said = {system_id: rig.speaker(system_id).frame(HEARTBEAT) for system_id in (1, 2)}
        assert rig.link.receive(said[1]) is True
        assert rig.link.receive(said[2]) is False
        assert [message.get_srcSystem() for message in heard] == [1]
        assert rig.link.heard_system_ids == {1}
        assert (rig.link.counters.received, rig.link.counters.refused) == (1, 1)
        assert log.came == [bytes(said[1])]


async def test_the_frame_log_gets_what_was_sent_and_not_what_could_not_be(make_rig, clock):
    log, rig = Taken(), make_rig(clock)
    rig.link = Link(Codec(), clock, log)
    async with rig.running():
        rig.wire.takes = False
        rig.link.post(command(10))
        await settle()
        rig.wire.takes = True
        rig.link.post(command(11))
        await settle()
        logged = [mavlink.MAVLink(None).decode(bytearray(frame)) for frame in log.went]
        assert [message.get_type() for message in logged] == ["HEARTBEAT", "COMMAND_LONG"]
        assert logged[1].command == 11


async def test_the_systems_whose_autopilots_are_heard_are_known_wanted_or_not(rig):
    assert rig.link.heard_system_ids == frozenset()
    rig.vehicle("U1", 3)
    for speaker in (rig.speaker(7), rig.speaker(1), rig.speaker(9, 154), rig.speaker(255, 190)):
        speaker.heartbeat()
    assert rig.link.heard_system_ids == {1, 7}


async def test_a_link_is_connecting_then_up_then_silent_and_down_when_the_connection_is_gone(rig):
    def state():
        return rig.link.status(rig.clock.now_s()).state

    assert state() is LinkState.CONNECTING
    rig.wire.connected = False
    assert state() is LinkState.CONNECTING
    rig.wire.connected = True
    rig.copter.heartbeat()
    assert state() is LinkState.UP
    await rig.clock.advance(2.0)
    assert state() is LinkState.UP
    await rig.clock.advance(2.0)
    assert state() is LinkState.SILENT
    rig.wire.connected = False
    assert state() is LinkState.DOWN
    rig.wire.connected = True
    rig.copter.heartbeat()
    assert state() is LinkState.UP
    rig.wire.connected = False
    assert state() is LinkState.DOWN


async def test_a_status_says_what_passed_and_who_was_heard(rig):
    rig.copter.heartbeat()
    rig.copter.sequence += 1
    rig.copter.heartbeat()
    rig.speaker(7).heartbeat()
    rig.wire.refused, rig.wire.skipped_bytes, rig.wire.contested_system_ids = 4, 5, frozenset({7})
    await rig.clock.advance(1.5)
    status = rig.link.status(rig.clock.now_s())
    assert status.address == "udpin:127.0.0.1:14550"
    assert (status.received, status.sent, status.lost) == (3, 2, 1)
    assert (status.refused, status.skipped_bytes, status.dropped) == (4, 5, 0)
    assert status.loss_ratio == pytest.approx(0.25)
    assert status.silent_for_s == pytest.approx(1.5)
    assert (status.heard_system_ids, status.contested_system_ids) == ((1, 7), (7,))


async def test_the_loss_ratio_is_of_the_last_seconds(rig):
    assert rig.link.status(rig.clock.now_s()).loss_ratio is None
    for number in range(0, 200, 2):  # every other frame is lost
        rig.copter.sequence = number
        rig.copter.heartbeat()
        await rig.clock.advance(0.1)
    assert rig.link.status(rig.clock.now_s()).loss_ratio == pytest.approx(0.5, abs=0.02)
    for _ in range(120):
        rig.copter.heartbeat()
        await rig.clock.advance(0.1)
    status = rig.link.status(rig.clock.now_s())
    assert status.loss_ratio == 0.0
    assert status.lost == 99
    await rig.clock.advance(11.0)
    assert rig.link.status(rig.clock.now_s()).loss_ratio is None, "nothing heard is not nothing lost"


async def test_two_vehicles_with_one_system_id_are_refused(rig):
    rig.vehicle("U1", 4)
    with pytest.raises(LinkError, match=r"udpin:127\.0\.0\.1:14550: two vehicles with system id 4.*SYSID_THISMAV"):
        rig.vehicle("U2", 4)
    rig.vehicle("U2", 5)


async def test_several_vehicles_share_a_link_and_hear_only_their_own(rig):
    first, second = rig.vehicle("U1", 1), rig.vehicle("U2", 2)
    rig.speaker(1).heartbeat(mode=4)
    rig.speaker(2).heartbeat(mode=9)
    assert (first.custom_mode, second.custom_mode) == (4, 9)


def test_a_link_that_is_not_open_has_no_address(clock):
    with pytest.raises(LinkError, match="not open"):
        _ = Link(Codec(), clock).address


async def test_an_open_link_speaks_and_listens_on_its_address_and_ends_with_the_block(clock):
    heard = asyncio.Queue()
    async with open_link(LinkAddress("udpin", "127.0.0.1", 0), Codec(), clock) as ground:
        assert ground.address.port > 0
        ground.listen(Subscription(255, frozenset({HEARTBEAT_ID}), heard.put_nowait))
        codec = Codec(255, mavlink.MAV_COMP_ID_AUTOPILOT1)
        async with open_link(LinkAddress("udpout", "127.0.0.1", ground.address.port), codec, clock) as air:
            message = await asyncio.wait_for(heard.get(), 5.0)
            assert message.get_srcSystem() == 255
            assert air.counters.sent == 1
    assert clock.sleeping == 0


async def test_a_port_in_use_is_an_error_that_names_the_link(clock):
    async with open_link(LinkAddress("udpin", "127.0.0.1", 0), Codec(), clock) as first:
        with pytest.raises(LinkError, match=f"udpin:127.0.0.1:{first.address.port} cannot be opened"):
            async with open_link(first.address, Codec(), clock):
                pass
