"""Who answers: the number of the hardware, the firmware, and whether it is one autopilot only."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.identity import TRIES, Identity, read_identities
from tests.fakes import settle

ARDUCOPTER_SITL_UID2 = [71, 100, 49, 50, 49, 57, 99, 55, 99, 52, 99, 53, 52, 48, 52, 97, 97, 0]
PX4_SITL_UID = 5283920058631409239


def version(uid=0, uid2=(), firmware=0x04060380):
    padded = [*uid2, *[0] * 18][:18]
    return mavlink.MAVLink_autopilot_version_message(0, firmware, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, uid, padded)


@pytest.fixture
async def asked(rig):
    """How to ask: returns the call, and the requests so far."""
    calls = []

    async def ask():
        calls.append(asyncio.create_task(read_identities(rig.vehicle())))
        await settle()
        return calls[-1]

    yield ask
    for call in calls:
        call.cancel()


def requests(rig):
    return [(message.command, message.param1) for message in rig.wire.commands]


@pytest.mark.parametrize(
    ("message", "uid", "firmware"),
    [
        pytest.param(version(uid2=ARDUCOPTER_SITL_UID2), bytes(ARDUCOPTER_SITL_UID2).hex(), "4.6.3", id="ArduCopter"),
        pytest.param(version(PX4_SITL_UID, [8], 0x011100FF), f"{PX4_SITL_UID:016x}08", "1.17.0", id="PX4"),
    ],
)
async def test_the_simulators_tell_a_number_in_either_field(message, uid, firmware):
    identity = Identity.of(message)
    assert identity.firmware == firmware
    assert uid in identity.uid


async def test_two_instances_have_two_numbers():
    first, second = version(uid2=[71, *ARDUCOPTER_SITL_UID2[1:]]), version(uid2=[72, *ARDUCOPTER_SITL_UID2[1:]])
    assert Identity.of(first) != Identity.of(second)


async def test_an_autopilot_that_leaves_both_zero_tells_no_number():
    assert Identity.of(version()).uid == ""


async def test_one_answer_to_one_question_is_one_autopilot(rig, asked):
    call = await asked()
    assert requests(rig) == [(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)]
    rig.copter.say(version(uid=5))
    rig.copter.say(version(uid=5))
    await rig.clock.advance(2.0)
    assert [identity.uid for identity in call.result()] == [Identity.of(version(uid=5)).uid]
    assert len(requests(rig)) == 1


async def test_a_second_autopilot_on_the_same_system_id_is_found(rig, asked):
    call = await asked()
    rig.copter.say(version(uid=5))
    await rig.clock.advance(0.3)
    rig.speaker(1).say(version(uid=6))
    await rig.clock.advance(2.0)
    assert len(call.result()) == 2


async def test_in_silence_it_asks_some_times_and_knows_nobody(rig, asked):
    call = await asked()
    await rig.clock.advance(10.0)
    assert call.result() == frozenset()
    assert len(requests(rig)) == TRIES
