"""A link on a bench: its wire and the autopilots behind it are played by the test, its clock moved by hand."""

import asyncio
import contextlib
import struct
from dataclasses import dataclass

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Codec
from drivers.mavlink.link import Link
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from tests.fakes import ManualClock, settle

ADDRESS = LinkAddress("udpin", "127.0.0.1", 14550)


@dataclass(frozen=True)
class Sent:
    time_s: float
    message: object
    system_id: int = 0


class FakeWire:
    """A transport that keeps what was sent, and when, while it `takes` anything; `on_send` sees each as it leaves."""

    def __init__(self, clock):
        self.address = ADDRESS
        self.connected = True
        self.backlogged = False
        self.takes = True
        self.skipped_bytes = self.refused = 0
        self.contested_system_ids = frozenset()
        self.sent = []
        self.on_send = None
        self._clock = clock
        self._decoder = mavlink.MAVLink(None)

    def send(self, frame, system_id=0):
        if not self.takes:
            return False
        message = self._decoder.decode(bytearray(frame))
        self.sent.append(Sent(self._clock.now_s(), message, system_id))
        if self.on_send is not None:
            self.on_send(message)
        return True

    @property
    def messages(self):
        """Everything but heartbeats, in the order it left."""
        return [sent.message for sent in self.sent if sent.message.get_type() != "HEARTBEAT"]

    @property
    def setpoints(self):
        return [sent for sent in self.sent if sent.message.get_type().startswith("SET_POSITION_TARGET")]

    @property
    def commands(self):
        return [message for message in self.messages if message.get_type() == "COMMAND_LONG"]


class Speaker:
    """Somebody on the other side of a link."""

    def __init__(self, link, system_id=1, component_id=1):
        self._link = link
        self._encoder = mavlink.MAVLink(None, system_id, component_id)

    @property
    def sequence(self):
        return self._encoder.seq

    @sequence.setter
    def sequence(self, number):
        self._encoder.seq = number

    def frame(self, message):
        packed = bytearray(message.pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256
        return packed

    def say(self, message):
        self._link.receive(self.frame(message))

    def heartbeat(self, mode=4, *, armed=True, autopilot=3, vehicle_type=2, status=4):
        base_mode = 1 | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
        self.say(mavlink.MAVLink_heartbeat_message(vehicle_type, autopilot, base_mode, mode, status, 3))

    def at_height(self, height_m):
        self.say(
            mavlink.MAVLink_global_position_int_message(
                0, 474_000_000, 85_000_000, 430_000, round(height_m * 1000), 150, -250, 50, 0
            )
        )

    def estimator(self, flags):
        self.say(mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.1))

    def health(self, sensors):
        self.say(mavlink.MAVLink_sys_status_message(0, 0, sensors, *(0,) * 10))

    def text(self, text):
        self.say(mavlink.MAVLink_statustext_message(3, text.encode()))

    def acknowledge(self, command, result=0):
        self.say(mavlink.MAVLink_command_ack_message(command, result))


class Rig:
    """An open link on a fake wire."""

    def __init__(self, clock):
        self.clock = clock
        self.wire = FakeWire(clock)
        self.link = Link(Codec(), clock)
        self.copter = Speaker(self.link)

    def speaker(self, system_id, component_id=1):
        return Speaker(self.link, system_id, component_id)

    def vehicle(self, name="U1", system_id=1):
        return Vehicle(name, system_id, self.link, self.clock)

    @contextlib.asynccontextmanager
    async def running(self):
        owner = asyncio.create_task(self.link.run(self.wire))
        await settle()
        try:
            yield self
            assert not owner.done(), "the owner of the link ended"
        finally:
            owner.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await owner


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
async def rig(clock):
    async with Rig(clock).running() as rig:
        yield rig


@pytest.fixture
def make_rig():
    """How to put a link on the bench with a clock."""
    return Rig


@pytest.fixture
def frame_of():
    """How to put a frame with the right length and checksum around any payload."""

    def frame(message_id, payload, *, incompat_flags=0):
        head = struct.pack(
            "<BBBBBBBHB", 0xFD, len(payload), incompat_flags, 0, 0, 1, 1, message_id & 0xFFFF, message_id >> 16
        )
        crc_extra = mavlink.mavlink_map[message_id].crc_extra if message_id in mavlink.mavlink_map else 0
        crc = mavlink.x25crc(head[1:] + payload + bytes([crc_extra]))
        return bytearray(head + payload + struct.pack("<H", crc.crc))

    return frame
