"""A million hostile bytes through every transport: nothing raises, nothing grows, the vehicle is heard after."""

import asyncio
import contextlib
import os
import pty
import socket
import tracemalloc

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import VehicleError
from drivers.mavlink.autopilots import ardupilot
from drivers.mavlink.codec import Codec, FrameSplitter
from drivers.mavlink.identity import read_identities
from drivers.mavlink.link import Link, open_link
from drivers.mavlink.parameters import bytewise_value, cast_value, read_parameters
from drivers.mavlink.redundant import RedundantLink
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits
from drivers.mavlink.signing import LinkSigner
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import SigningKey
from drivers.mavlink.timesync import measure_clock
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from planner.frames import GeodeticPosition, SiteFrame
from tests.drivers.mavlink.hostile import Hostile
from tests.fakes import ManualClock, settle

MILLION = 1_000_000
LOOPBACK = "127.0.0.1"
LARGEST_GROWTH = 300_000
"""Bytes: what a run may hold on to, whatever it was sent."""
SITE = SiteFrame(GeodeticPosition(47.0, 8.0, 400.0))


def pieces(seed, total=MILLION):
    hostile, sent = Hostile(seed), 0
    while sent < total:
        piece = hostile.datagram()
        sent += len(piece)
        yield piece


class Arrivals:
    """Counts the bytes that links read: the kernel hands them over in its own time, on a busy machine not at once."""

    def __init__(self, monkeypatch):
        self.read, self.sent = 0, 0
        for way in ("datagram", "stream"):
            monkeypatch.setattr(FrameSplitter, way, self._counting(getattr(FrameSplitter, way)))

    def _counting(self, split):
        def counted(splitter, data):
            self.read += len(data)
            return split(splitter, data)

        return counted

    async def of_all(self):
        """Wait until all that was sent was read, and acted on."""
        async with asyncio.timeout(30):
            while self.read < self.sent:  # noqa: ASYNC110 - the kernel sets no event
                await asyncio.sleep(0)
        await settle()


class Udp:
    """The other side of a UDP link, whichever side speaks first."""

    def __init__(self):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((LOOPBACK, 0))
        self._socket.settimeout(0.0)
        self._port = self._socket.getsockname()[1]

    @contextlib.asynccontextmanager
    async def open(self, codec, clock):
        raise NotImplementedError

    async def send(self, data):
        self._socket.sendto(data, self._to)
        with contextlib.suppress(BlockingIOError):
            while True:
                self._socket.recv(65536)


class UdpIn(Udp):
    @contextlib.asynccontextmanager
    async def open(self, codec, clock):
        with self._socket:
            async with open_link(LinkAddress("udpin", LOOPBACK, 0), codec, clock) as link:
                self._to = (LOOPBACK, link.address.port)
                yield link


class UdpOut(Udp):
    @contextlib.asynccontextmanager
    async def open(self, codec, clock):
        with self._socket:
            async with open_link(LinkAddress("udpout", LOOPBACK, self._port), codec, clock) as link:
                _, self._to = await asyncio.get_running_loop().sock_recvfrom(self._socket, 65536)
                yield link


class Tcp:
    @contextlib.asynccontextmanager
    async def open(self, codec, clock):
        connected = asyncio.get_running_loop().create_future()

        async def serve(reader, writer):
            connected.set_result(writer)
            with contextlib.suppress(ConnectionError):
                while await reader.read(65536):
                    pass

        server = await asyncio.start_server(serve, LOOPBACK, 0)
        async with server:
            address = LinkAddress("tcp", LOOPBACK, server.sockets[0].getsockname()[1])
            async with open_link(address, codec, clock) as link:
                self._writer = await connected
                yield link
                assert not self._writer.is_closing(), "the connection was dropped"
                self._writer.close()

    async def send(self, data):
        self._writer.write(data)
        await self._writer.drain()


class Serial:
    @contextlib.asynccontextmanager
    async def open(self, codec, clock):
        radio, port = pty.openpty()
        os.set_blocking(radio, False)
        try:
            async with open_link(LinkAddress("serial", os.ttyname(port), 57600), codec, clock) as link:
                while link.counters.sent == 0:
                    link.post(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
                    await asyncio.sleep(0.001)
                self._radio = radio
                yield link
        finally:
            os.close(radio)
            os.close(port)

    async def send(self, data):
        while data:
            with contextlib.suppress(BlockingIOError):
                data = data[os.write(self._radio, data) :]
            await asyncio.sleep(0)
            with contextlib.suppress(BlockingIOError):
                os.read(self._radio, 65536)


class Rider:
    """What hangs on a vehicle in flight, made to act on all it is told."""

    def __init__(self, link, clock):
        self.vehicle = Vehicle("U1", 1, link, clock)
        self.stream = SetpointStreamer(self.vehicle, ardupilot.ArduCopter(), 10.0, StreamLimits(), clock)
        self.vehicle.on_kinematics.append(lambda kinematics: SITE.from_geodetic(kinematics.position))
        self.vehicle.on_heartbeat.append(lambda heartbeat: self.stream.release())
        self.vehicle.on_heartbeat.append(lambda heartbeat: self.stream.renew(1 + 1j))


@pytest.fixture
async def escaped():
    """The exceptions that reach the event loop: none may."""
    reports = []
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: reports.append(context))
    yield reports
    await settle()
    assert reports == []


@contextlib.contextmanager
def no_growth():
    """Measure what is held on to from now to the end of the block."""
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        yield
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < LARGEST_GROWTH


@pytest.mark.parametrize("transport", [UdpIn, UdpOut, Tcp, Serial])
async def test_a_million_hostile_bytes_leave_the_link_and_the_vehicle_as_good_as_before(
    transport, escaped, monkeypatch
):
    clock, air, wire, arrivals = ManualClock(), Codec(1, 1), transport(), Arrivals(monkeypatch)

    async def send(data):
        arrivals.sent += len(data)
        await wire.send(data)

    async def hear(vehicle, number):
        """Send the vehicle's heartbeat until it is heard: behind garbage a stream may wait for a frame's length."""
        for _ in range(30):
            await send(air.encode(mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 0x7E570000 + number, 4, 3)))
            await arrivals.of_all()
            if vehicle.custom_mode == 0x7E570000 + number:
                return
        pytest.fail("the vehicle is not heard any more")

    async with wire.open(Codec(), clock) as link:
        rider = Rider(link, clock)
        with no_growth():
            for number, piece in enumerate(pieces(seed=transport.__name__)):
                await send(piece)
                if number % 8 == 0:
                    await asyncio.sleep(0)
                if number % 500 == 0:
                    await clock.advance(0.3)
                    await hear(rider.vehicle, number)
        assert link.counters.received > 1000


async def test_a_million_hostile_bytes_pass_no_signed_link(escaped):
    clock = ManualClock()
    key, signing_clock = SigningKey(b"k" * 32), SigningClock(clock)
    codec = Codec(signing=LinkSigner(key, signing_clock, 1, "here"))
    air = Codec(1, 1, signing=LinkSigner(key, signing_clock, 0, "there"))
    link = Link(codec, clock)
    rider, splitter = Rider(link, clock), FrameSplitter()
    for piece in pieces(seed=5):
        for frame in splitter.datagram(piece):
            link.receive(frame)
    assert rider.vehicle.telemetry.heartbeat is None
    refused = codec.signing.refused
    assert refused.unsigned > 1000
    assert refused.wrong_signature > 100
    link.receive(bytearray(air.encode(mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 4, 4, 3))))
    assert rider.vehicle.custom_mode == 4


async def test_questions_to_a_vehicle_end_whatever_it_answers(rig, escaped):
    clock, vehicle, hostile = rig.clock, rig.vehicle(), Hostile(6)
    for value_of in (cast_value, bytewise_value):
        asking = [
            asyncio.create_task(question)
            for question in (
                read_parameters(vehicle, ["GUID_TIMEOUT", "x" * 16], value_of),
                read_identities(vehicle),
                measure_clock(vehicle),
                obeys(vehicle),
            )
        ]
        for _ in range(3000):
            rig.link.receive(bytearray(hostile.absurd()))
            await settle()
            await clock.advance(0.01)
        assert all(task.done() for task in asking)
        await asyncio.gather(*asking)


async def obeys(vehicle):
    with contextlib.suppress(VehicleError):
        await vehicle.command(400, 1.0, what="arming")


def position(boot_s, latitude_deg):
    return mavlink.MAVLink_global_position_int_message(
        round(boot_s * 1000), round(latitude_deg * 1e7), 0, 0, 0, 0, 0, 0, 0
    )


async def test_one_absurd_time_ends_the_positions_for_a_moment_only(rig):
    """A damaged message passes its checksum once in 65,536 times."""
    vehicle, clock = rig.vehicle(), rig.clock
    rig.copter.say(position(100.0, 1.0))
    rig.copter.say(position(2**32 / 1000 - 0.001, 2.0))
    for tenth in range(60):
        clock.jump(0.1)
        rig.copter.say(position(100.0 + tenth / 10, 3.0))
    assert vehicle.telemetry.kinematics.position.latitude_deg == pytest.approx(3.0)


async def test_a_vehicle_on_two_links_is_heard_after_hostile_bytes_on_both(clock, make_rig, escaped):
    rigs = [make_rig(clock), make_rig(clock)]
    for rig in rigs:
        rig.link._transport = rig.wire
    rider = Rider(RedundantLink(1, [rig.link for rig in rigs], clock), clock)
    splitters = [FrameSplitter() for _ in rigs]
    with no_growth():
        for number, piece in enumerate(pieces(seed=8)):
            for frame in splitters[number % 2].datagram(piece):
                rigs[number % 2].link.receive(frame)
            clock.jump(0.001)
            if number % 500 == 0:
                clock.jump(10.0)
                for tenth in range(100):
                    clock.jump(0.1)
                    for rig in rigs:
                        rig.copter.say(position(1000.0 + number + tenth / 10, 3.0))
                        rig.copter.heartbeat(mode=0x7E570000 + number)
                assert rider.vehicle.custom_mode == 0x7E570000 + number
                assert rider.vehicle.telemetry.kinematics.position.latitude_deg == pytest.approx(3.0)


async def test_an_endless_text_is_not_kept(rig):
    vehicle = rig.vehicle()
    with no_growth():
        for piece in range(6_000):
            rig.copter.say(mavlink.MAVLink_statustext_message(3, b"x" * 50, 7, piece % 256))
    assert sum(len(text) for text in vehicle.telemetry.status_texts) < 100_000


@pytest.mark.parametrize("result", [*range(12), 255])
async def test_every_result_of_a_command_is_success_or_an_error_in_words(rig, result):
    vehicle = rig.vehicle()
    task = asyncio.create_task(vehicle.command(400, 1.0, what="arming"))
    await settle()
    rig.copter.acknowledge(400, result)
    await rig.clock.advance(10.0)
    if result == mavlink.MAV_RESULT_ACCEPTED:
        await task
        return
    with pytest.raises(VehicleError, match="arming"):
        await task


async def test_no_text_of_an_autopilot_can_steer_a_terminal(rig):
    vehicle, hostile = rig.vehicle(), Hostile(7)
    for _ in range(3000):
        rig.link.receive(bytearray(hostile.absurd()))
        assert all(text.isprintable() for text in vehicle.telemetry.status_texts)
    assert len(vehicle.telemetry.status_texts) == 20
