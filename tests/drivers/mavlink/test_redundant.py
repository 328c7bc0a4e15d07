"""Two links to one vehicle: no lease is lost on a change, nothing old arrives, and a stop goes out everywhere."""

import asyncio
import contextlib
import itertools
import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import LinkError
from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.link import Setpoint, Subscription
from drivers.mavlink.redundant import ASK_AGAIN_S, RedundantLink
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits, StreamState
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from tests.fakes import settle

GUIDED, LOITER = 4, 5
PERIOD_S = 0.2
SET_INTERVAL, SET_MODE = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_DO_SET_MODE
REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE


def command(number, parameter=0.0):
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, parameter, 0, 0, 0, 0, 0, 0)


def setpoint(north_mps, expires_s):
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0x05C7, 0, 0, 0, north_mps, 0, 0, 0, 0, 0, 0, 0
    )
    return Setpoint(message, expires_s, stops=north_mps == 0.0)


class Field:
    """Two rigs with a clock in common: an autopilot that hovers in GUIDED speaks on each link that is `up`."""

    def __init__(self, make_rig, clock):
        self.clock = clock
        self.rigs = [make_rig(clock), make_rig(clock)]
        for number, rig in enumerate(self.rigs):
            rig.wire.address = LinkAddress("udpin", "127.0.0.1", 14550 + number)
        self.up = [True, True]
        self.delay_s = [0.0, 0.0]
        self.link = RedundantLink(1, [rig.link for rig in self.rigs], clock)
        self.switched_on_s = clock.now_s() - 50.0
        self._queues = [[], []]

    def speak(self, mode=GUIDED):
        """Tell mode and position once; what is delayed comes with a later call."""
        boot_ms = round((self.clock.now_s() - self.switched_on_s) * 1000)
        for number, rig in enumerate(self.rigs):
            if not self.up[number]:
                continue
            queue = self._queues[number]
            queue.append((self.clock.now_s() + self.delay_s[number], boot_ms, mode))
            while queue and queue[0][0] <= self.clock.now_s() + 1e-6:
                _, told_ms, told_mode = queue.pop(0)
                rig.copter.heartbeat(mode=told_mode)
                rig.copter.say(mavlink.MAVLink_global_position_int_message(told_ms, told_ms, 0, 0, 10_000, 0, 0, 0, 0))

    async def live(self, duration_s, each=lambda: None):
        for _ in range(round(duration_s / PERIOD_S)):
            self.speak()
            each()
            await self.clock.advance(PERIOD_S)

    def sent(self, number):
        """(time, north velocity) of every setpoint that left on a link."""
        return [(sent.time_s, sent.message.vx) for sent in self.rigs[number].wire.setpoints]

    def commands(self, number):
        return [message.command for message in self.rigs[number].wire.commands]


@pytest.fixture
async def field(make_rig, clock):
    field = Field(make_rig, clock)
    async with contextlib.AsyncExitStack() as stack:
        for rig in field.rigs:
            await stack.enter_async_context(rig.running())
        yield field


def of_kind(heard, kind):
    return [message for message in heard if message.get_type() == kind]


@pytest.fixture
def heard(field):
    messages = []
    wanted = frozenset(
        {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
            mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT,
        }
    )
    field.link.listen(Subscription(1, wanted, messages.append))
    return messages


class Flight:
    """A vehicle on both links, its stream running."""

    def __init__(self, field):
        self.field = field
        self.vehicle = Vehicle("U1", 1, field.link, field.clock)
        field.speak()
        self.stream = SetpointStreamer(
            self.vehicle, ArduCopter(), 10.0, StreamLimits(rate_hz=10.0, lease_s=0.5), field.clock
        )

    def renew(self):
        self.stream.renew(3 + 0j)

    @property
    def sent(self):
        return sorted([*self.field.sent(0), *self.field.sent(1)])


@pytest.fixture
async def flight(field):
    flight = Flight(field)
    runner = asyncio.create_task(flight.stream.run())
    yield flight
    runner.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await runner


async def test_motion_leaves_on_the_preferred_link_alone(field, flight):
    await field.live(3.0, flight.renew)
    assert len(field.sent(0)) > 20
    assert field.sent(1) == []
    assert field.link.address.port == 14550


async def test_when_the_link_in_use_dies_the_stream_goes_on_on_the_other_with_hardly_a_gap(field, flight):
    await field.live(3.0, flight.renew)
    field.up[0], died_s = False, field.clock.now_s()
    await field.live(3.0, flight.renew)
    heard = [(time_s, v) for time_s, v in field.sent(0) if time_s <= died_s] + field.sent(1)
    gaps = [later - earlier for (earlier, _), (later, _) in itertools.pairwise(heard)]
    assert max(gaps) < 0.4
    assert {velocity for _, velocity in heard} == {3.0}, "the lease was lost"
    assert field.sent(0)[-1][0] < died_s + 0.4, "motion went on into a dead link"
    assert flight.stream.state is StreamState.LEASED
    assert field.link.address.port == 14551


async def test_a_change_of_links_posts_the_latest_setpoint_at_once_and_takes_it_off_the_link_left(field, heard):
    await field.live(3.0)
    field.up[0] = False
    field.link.post_setpoint(1, setpoint(2.0, field.clock.now_s() + 9.0))
    await field.live(0.2)
    field.rigs[0].link.post_setpoint(1, setpoint(2.0, field.clock.now_s() + 9.0))  # its owner has not had its turn
    field.speak()
    await settle()
    assert field.sent(1) == [(field.clock.now_s(), 2.0)]
    assert len(field.sent(0)) == 1


async def test_a_busy_event_loop_is_no_reason_to_change_links(field, heard):
    """What came meanwhile on one link is read before what came on the other."""
    await field.live(3.0)
    field.clock.jump(0.7)
    for number in (1, 0):
        field.rigs[number].copter.heartbeat()
    assert field.link.address.port == 14550


async def test_a_setpoint_whose_lease_has_ended_is_not_posted_again_on_a_change(field, heard):
    await field.live(3.0)
    field.up[0] = False
    field.link.post_setpoint(1, setpoint(2.0, field.clock.now_s() + 0.2))
    await settle()
    await field.live(1.0)
    assert field.link.address.port == 14551
    assert field.sent(1) == []


async def test_a_setpoint_that_was_dropped_is_not_posted_again_on_a_change(field, heard):
    await field.live(3.0)
    field.up[0] = False
    field.link.post_setpoint(1, setpoint(2.0, field.clock.now_s() + 9.0))
    field.link.drop_setpoint(1)
    await field.live(1.0)
    assert field.link.address.port == 14551
    assert field.sent(0) == field.sent(1) == []


async def test_a_stop_that_was_dropped_leaves_on_no_link(field, heard):
    await field.live(1.0)
    field.link.post_setpoint(1, setpoint(0.0, field.clock.now_s() + 9.0))
    field.link.drop_setpoint(1)
    await settle()
    assert field.sent(0) == field.sent(1) == []


async def test_what_is_sent_is_an_occasion_to_leave_a_link_that_has_fallen_silent(field, heard):
    await field.live(3.0)
    field.up[0] = False
    field.speak()
    await field.clock.advance(0.1)
    field.link.post_setpoint(1, setpoint(2.0, field.clock.now_s() + 9.0))
    await settle()
    assert (field.sent(0), field.sent(1)) == ([], [(field.clock.now_s(), 2.0)])


async def test_a_stop_leaves_on_every_link_and_comes_after_any_motion_on_each(field, flight):
    await field.live(2.0, flight.renew)
    field.up[0] = False
    await field.live(1.0, flight.renew)
    flight.stream.stop()
    await field.live(1.0)
    for number in (0, 1):
        velocities = [velocity for _, velocity in field.sent(number)]
        assert 3.0 in velocities
        assert velocities[-5:] == [0.0] * 5


async def test_a_stop_still_waiting_on_the_other_link_does_not_follow_a_later_motion(field, heard):
    await field.live(1.0)
    field.link.post_setpoint(1, setpoint(0.0, field.clock.now_s() + 9.0))
    field.link.post_setpoint(1, setpoint(1.0, field.clock.now_s() + 9.0))
    await settle()
    assert ([v for _, v in field.sent(0)], field.sent(1)) == ([1.0], [])


async def test_commands_that_stop_leave_on_every_link_and_take_the_motion_with_them(field, flight):
    await field.live(1.0, flight.renew)
    sent = len(flight.sent)
    flight.stream.renew(3 + 0j)
    ArduCopter().hold(flight.vehicle)
    await settle()
    assert field.commands(0) == field.commands(1) == [SET_MODE]
    assert len(flight.sent) == sent


async def test_ordinary_commands_leave_on_the_link_in_use_alone(field, heard):
    await field.live(2.0)
    field.link.post(command(400))
    await settle()
    field.up[0] = False
    await field.live(1.0)
    field.link.post(command(22))
    await settle()
    assert (field.commands(0), field.commands(1)) == ([400], [22])


async def test_an_ordinary_command_does_not_go_into_a_link_that_has_fallen_silent(field, heard):
    await field.live(3.0)
    field.up[0] = False
    field.speak()
    await field.clock.advance(0.1)
    field.link.post(command(400))
    await settle()
    assert (field.commands(0), field.commands(1)) == ([], [400])


async def test_a_message_is_requested_on_every_link_and_not_again_when_one_comes_up(field, heard):
    field.up[1] = False
    await field.live(1.0)
    field.link.post(command(REQUEST, 148.0))
    await field.live(4.0)
    field.up[1] = True
    await field.live(4.0)
    assert field.commands(0) == field.commands(1) == [REQUEST]


async def test_rates_are_asked_for_on_every_link_and_again_when_one_comes_up(field, heard):
    field.up[1] = False
    await field.live(1.0)
    field.link.post(command(SET_INTERVAL, 33.0))
    field.link.post(command(SET_INTERVAL, 1.0))
    field.link.post(command(SET_INTERVAL, 33.0))
    await settle()
    assert field.commands(0) == field.commands(1) == [SET_INTERVAL] * 3
    await field.live(4.0)
    field.up[1] = True
    await field.live(4.0)
    asked = [message.param1 for message in field.rigs[1].wire.commands[3:]]
    assert sorted(asked) == [1.0, 33.0], "each rate once"
    assert len(field.commands(0)) == 3


async def test_a_link_that_brings_only_heartbeats_is_asked_for_the_rates_now_and_then(field, heard):
    field.up[1] = False
    field.link.post(command(SET_INTERVAL, 33.0))
    for _ in range(100):
        field.speak()
        field.rigs[1].copter.heartbeat()
        await field.clock.advance(PERIOD_S)
    asked = len(field.commands(1)) - 1
    assert 20.0 / ASK_AGAIN_S - 1 <= asked <= 20.0 / ASK_AGAIN_S + 1


async def test_one_answer_is_taken_to_a_command_sent_on_every_link(field, heard):
    field.link.post_urgent(command(SET_MODE))
    await settle()
    field.rigs[1].copter.acknowledge(SET_MODE)
    field.rigs[0].copter.acknowledge(SET_MODE)
    assert [message.get_type() for message in heard] == ["COMMAND_ACK"]


@pytest.mark.parametrize(("way", "number"), [("post_urgent", SET_MODE), ("post", REQUEST), ("post", SET_INTERVAL)])
async def test_an_answer_is_taken_from_any_link_whichever_answered_before(field, heard, way, number):
    for answering in (0, 1):
        getattr(field.link, way)(command(number))
        field.rigs[answering].copter.acknowledge(number)
    assert len(of_kind(heard, "COMMAND_ACK")) == 2


async def test_the_answer_to_an_ordinary_command_is_not_one_to_an_earlier_copy(field, heard):
    await field.live(1.0)
    field.link.post_urgent(command(SET_MODE))
    field.link.post(command(SET_MODE))
    field.rigs[1].copter.acknowledge(SET_MODE, mavlink.MAV_RESULT_ACCEPTED)
    field.rigs[0].copter.acknowledge(SET_MODE, mavlink.MAV_RESULT_DENIED)
    answers = [message.result for message in heard if message.get_type() == "COMMAND_ACK"]
    assert answers == [mavlink.MAV_RESULT_DENIED]


@pytest.mark.parametrize("brought_by", [(0, 1, 1, 0), (0, 0, 1, 1), (0, 0), (0, 1, 1)])
async def test_a_text_is_said_once_and_as_often_as_the_autopilot_said_it(field, heard, brought_by):
    for number in brought_by:
        field.rigs[number].copter.text("PreArm: compass")
    field.rigs[1].copter.text("only here")
    assert [message.text for message in heard] == ["PreArm: compass", "PreArm: compass", "only here"]


async def test_what_only_a_late_link_tells_of_what_happened_is_heard(field, heard):
    field.delay_s[1] = 3.0
    await field.live(6.0)
    field.rigs[1].copter.text("Radio failsafe")
    assert [message.text for message in of_kind(heard, "STATUSTEXT")] == ["Radio failsafe"]


async def test_a_position_that_both_links_tell_is_handed_on_once(field, heard):
    await field.live(2.0)
    told_ms = [message.time_boot_ms for message in of_kind(heard, "GLOBAL_POSITION_INT")]
    assert len(told_ms) == len(set(told_ms)) == 10


async def test_the_slow_link_does_not_undo_the_mode_nor_the_position_that_the_quick_one_told(field, flight):
    field.delay_s[1] = 3.0
    await field.live(6.0, flight.renew)
    for _ in range(10):  # the pilot takes it, and the slow link still says GUIDED
        field.speak(mode=LOITER)
        await field.clock.advance(PERIOD_S)
        assert flight.vehicle.custom_mode == LOITER
        age_s = (
            field.clock.now_s() - field.switched_on_s - flight.vehicle.telemetry.kinematics.position.latitude_deg * 1e4
        )
        assert age_s < 2 * PERIOD_S
    flight.stream.release()
    assert flight.stream.state is StreamState.PILOT


async def test_a_take_over_is_seen_on_the_other_link_when_the_one_in_use_has_just_died(field, flight):
    await field.live(3.0, flight.renew)
    field.up[0] = False
    field.speak(mode=LOITER)
    await settle()
    left = len(flight.sent)
    await field.live(2.0, flight.renew)
    assert flight.stream.state is StreamState.PILOT
    assert len(flight.sent) == left


async def test_a_link_that_is_late_is_not_spoken_on_while_the_other_is_prompt(field, flight):
    await field.live(3.0, flight.renew)
    field.delay_s[0] = 2.0  # heard steadily all the same
    await field.live(10.0, flight.renew)
    assert field.link.address.port == 14551
    field.delay_s[0] = 0.0
    await field.live(8.0, flight.renew)
    assert field.link.address.port == 14550


async def test_the_preferred_link_is_returned_to_without_a_gap_when_it_has_been_good_for_a_while(field, flight):
    await field.live(2.0, flight.renew)
    field.up[0] = False
    await field.live(2.0, flight.renew)
    field.up[0] = True
    await field.live(4.0, flight.renew)
    assert field.link.address.port == 14551
    await field.live(3.0, flight.renew)
    assert field.link.address.port == 14550
    back = [at for at in flight.sent if at[0] > field.clock.now_s() - 6.0]
    assert max(later - earlier for (earlier, _), (later, _) in itertools.pairwise(back)) < 0.2


async def test_a_change_is_warned_of_and_changes_to_and_fro_are_not(field, heard, caplog):
    await field.live(2.0)
    for _ in range(4):
        for number in (0, 1):
            field.up = [number == 1, number == 0]
            await field.live(1.6)
    warnings = [record.message for record in caplog.records if record.levelname == "WARNING"]
    assert 1 <= len(warnings) <= 2
    assert "system id 1: on udpin:127.0.0.1:14551 now, not on udpin:127.0.0.1:14550" in warnings[0]


async def test_other_vehicles_share_the_links_each_with_its_own_choice(field, flight):
    second_link = RedundantLink(2, [rig.link for rig in field.rigs], field.clock)
    second = Vehicle("U2", 2, second_link, field.clock)

    def second_speaks():
        flight.renew()
        field.rigs[0].speaker(2).heartbeat(mode=GUIDED)

    await field.live(2.0, second_speaks)
    field.up[0] = False  # for the first vehicle
    await field.live(2.0, second_speaks)
    assert field.link.address.port == 14551
    assert second_link.address.port == 14550
    assert second.custom_mode == GUIDED
    assert field.link.heard_system_ids == {1, 2}


async def test_what_either_link_hears_of_strangers_is_known(field):
    field.rigs[0].speaker(7).heartbeat()
    field.rigs[1].speaker(9).heartbeat()
    field.rigs[1].wire.contested_system_ids = frozenset({9})
    assert field.link.heard_system_ids == {7, 9}
    assert field.link.contested_system_ids == {9}


async def test_links_that_are_not_different_ones_are_refused(field):
    link = field.rigs[0].link
    for links in ([], [link, link]):
        with pytest.raises(LinkError, match="system id 1: each of a vehicle's links"):
            RedundantLink(1, links, field.clock)


async def test_the_way_to_one_vehicle_leads_to_no_other(field):
    with pytest.raises(LinkError, match="the way to system id 1, not to 2"):
        field.link.listen(Subscription(2, frozenset(), print))
    with pytest.raises(LinkError, match="the way to system id 1, not to 2"):
        field.link.post_setpoint(2, setpoint(1.0, 1e9))
    with pytest.raises(LinkError, match="the way to system id 1, not to 2"):
        field.link.drop_setpoint(2)


@pytest.mark.parametrize("seed", range(20))
async def test_whatever_the_links_do_no_motion_outlives_its_lease_and_a_stop_is_the_last_word_on_both(
    field, flight, seed
):
    chance = random.Random(seed)
    renewed_s = field.clock.now_s()
    for _ in range(60):
        field.up = [chance.random() < 0.7, chance.random() < 0.7]
        field.delay_s = [chance.choice([0.0, 0.0, 1.0]), chance.choice([0.0, 0.0, 1.0])]
        if chance.random() < 0.6:
            flight.renew()
            renewed_s = field.clock.now_s()
        await field.live(chance.choice([0.2, 0.4, 1.0]))
        for time_s, velocity in flight.sent:
            assert not velocity or time_s <= renewed_s + 0.5
    flight.renew()
    await field.live(0.2)
    flight.stream.stop()
    await field.live(1.0)
    for number in (0, 1):
        if field.sent(number):
            assert field.sent(number)[-1][1] == 0.0
    assert flight.sent
