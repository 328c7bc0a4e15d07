"""Parameters are read by name, asked for again when they do not come, and decoded as their autopilot encodes them."""

import asyncio
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.parameters import TRIES, bytewise_value, cast_value, read_parameters
from tests.fakes import settle

INT32, INT8, UINT8, REAL32 = (
    mavlink.MAV_PARAM_TYPE_INT32,
    mavlink.MAV_PARAM_TYPE_INT8,
    mavlink.MAV_PARAM_TYPE_UINT8,
    mavlink.MAV_PARAM_TYPE_REAL32,
)


def value(name, number, kind=REAL32):
    return mavlink.MAVLink_param_value_message(name.encode(), number, kind, 900, 65535)


class Autopilot:
    """Answers what it is asked for, except what it does not know and what it loses."""

    def __init__(self, rig, **parameters):
        self.parameters = parameters
        self.deaf_for = 0
        self.asked = []
        self._speaker = rig.copter
        rig.wire.on_send = self._answer

    def _answer(self, message):
        if message.get_type() != "PARAM_REQUEST_READ":
            return
        assert (message.target_system, message.target_component, message.param_index) == (1, 1, -1)
        self.asked.append(message.param_id)
        if self.deaf_for:
            self.deaf_for -= 1
        elif message.param_id in self.parameters:
            answer = value(message.param_id, self.parameters[message.param_id])
            asyncio.get_running_loop().call_soon(self._speaker.say, answer)


async def read(rig, *names):
    call = asyncio.create_task(read_parameters(rig.vehicle(), names, cast_value))
    for _ in range(10):
        await rig.clock.advance(1.0)
    assert call.done()
    return call.result()


async def test_every_name_is_asked_for_once_when_all_answer(rig):
    autopilot = Autopilot(rig, GUID_TIMEOUT=1.0, FS_GCS_ENABLE=5.0)
    assert await read(rig, "GUID_TIMEOUT", "FS_GCS_ENABLE", "GUID_TIMEOUT") == {
        "GUID_TIMEOUT": 1.0,
        "FS_GCS_ENABLE": 5.0,
    }
    assert autopilot.asked == ["GUID_TIMEOUT", "FS_GCS_ENABLE"]


async def test_a_name_the_autopilot_does_not_know_is_left_out_after_some_tries(rig):
    autopilot = Autopilot(rig, GUID_TIMEOUT=1.0)
    assert await read(rig, "GUID_TIMEOUT", "MAV_GCS_SYSID") == {"GUID_TIMEOUT": 1.0}
    assert autopilot.asked.count("MAV_GCS_SYSID") == TRIES
    assert autopilot.asked.count("GUID_TIMEOUT") == 1


async def test_what_is_lost_is_asked_for_again(rig):
    autopilot = Autopilot(rig, GUID_TIMEOUT=1.0)
    autopilot.deaf_for = TRIES - 1
    assert await read(rig, "GUID_TIMEOUT") == {"GUID_TIMEOUT": 1.0}


async def test_no_more_are_asked_for_at_once_than_an_autopilot_queues(rig):
    names = [f"P{number}" for number in range(30)]
    autopilot = Autopilot(rig)
    call = asyncio.create_task(read_parameters(rig.vehicle(), names, cast_value))
    await settle()
    assert len(autopilot.asked) == 20
    call.cancel()


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
async def test_a_value_that_is_no_number_is_none(rig, number):
    Autopilot(rig, GUID_TIMEOUT=number)
    assert await read(rig, "GUID_TIMEOUT") == {}


async def test_another_stations_downloads_are_not_taken_in(rig):
    call = asyncio.create_task(read_parameters(rig.vehicle(), ["GUID_TIMEOUT"], cast_value))
    await settle()
    rig.copter.say(value("RTL_ALT", 1500.0))
    rig.copter.say(value("GUID_TIMEOUT", 3.0))
    await settle()
    assert call.result() == {"GUID_TIMEOUT": 3.0}


@pytest.mark.parametrize(
    ("kind", "packed", "expected"),
    [
        (INT32, struct.pack("<i", 5), 5.0),
        (INT32, struct.pack("<i", -1), -1.0),
        (INT32, struct.pack("<i", 121212), 121212.0),
        (INT8, struct.pack("<b3x", -3), -3.0),
        (UINT8, struct.pack("<B3x", 200), 200.0),
        (REAL32, struct.pack("<f", 0.25), 0.25),
    ],
)
def test_px4_puts_the_bytes_of_an_integer_in_the_place_of_a_float(kind, packed, expected):
    sent = value("X", struct.unpack("<f", packed)[0], kind)
    received = mavlink.MAVLink(None).decode(bytearray(sent.pack(mavlink.MAVLink(None, 1, 1))))
    assert bytewise_value(received) == expected


def test_ardupilot_sends_an_integer_as_the_float_it_equals():
    assert cast_value(value("FS_GCS_ENABLE", 5.0, INT8)) == 5.0
