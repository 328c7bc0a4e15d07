"""UDP over loopback: it answers who it should, a flood starves nobody, and sending never waits nor raises."""

import asyncio
import contextlib
import itertools
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import LinkError
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.transports import open_transport
from tests.fakes import settle

LOOPBACK = "127.0.0.1"
PATIENCE_S = 5.0
LISTENING = LinkAddress("udpin", LOOPBACK, 0)


class Peer:
    """The other side of a UDP link."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((LOOPBACK, 0))
        self.socket.settimeout(0.0)
        self.port = self.socket.getsockname()[1]

    def send(self, data, port):
        self.socket.sendto(data, (LOOPBACK, port))

    async def hear(self):
        return await asyncio.wait_for(asyncio.get_running_loop().sock_recv(self.socket, 65536), PATIENCE_S)

    def heard_nothing(self):
        with pytest.raises(BlockingIOError):
            self.socket.recv(65536)
        return True


@pytest.fixture
def make_peer():
    with contextlib.ExitStack() as stack:

        def make():
            peer = Peer()
            stack.callback(peer.socket.close)
            return peer

        yield make


async def test_udpin_is_silent_until_spoken_to(make_peer, ears, frames):
    peer = make_peer()
    async with open_transport(LISTENING, ears) as transport:
        assert not transport.send(b"to nobody", 1)
        assert not transport.send(b"to nobody")
        peer.send(frames[0], transport.address.port)
        assert await ears.next() == frames[0]
        assert transport.send(b"to the vehicle", 1)
        assert await peer.hear() == b"to the vehicle"


async def test_vehicles_behind_one_port_are_each_answered_and_all_get_what_is_for_all(make_peer, ears, frame_by):
    first, second = make_peer(), make_peer()
    async with open_transport(LISTENING, ears) as transport:
        for peer, system_id in ((first, 1), (second, 2), (second, 3)):
            peer.send(frame_by(system_id=system_id), transport.address.port)
            await ears.next()
        for system_id, peer in ((2, second), (1, first), (3, second)):
            transport.send(b"to %d" % system_id, system_id)
            assert await peer.hear() == b"to %d" % system_id
        transport.send(b"to all")
        assert await first.hear() == await second.hear() == b"to all"
        assert first.heard_nothing()
        assert second.heard_nothing()


async def test_a_stranger_draws_no_answer_and_its_frames_are_refused_counted_and_said(
    make_peer, ears, frame_by, caplog
):
    vehicle, stranger = make_peer(), make_peer()
    async with open_transport(LISTENING, ears) as transport:
        port = transport.address.port
        vehicle.send(frame_by(), port)
        await ears.next()
        for _ in range(3):
            stranger.send(frame_by(), port)
        vehicle.send(frame_by(system_id=1), port)
        await ears.next()
        await settle()
        assert ears.empty
        transport.send(b"setpoint", 1)
        assert await vehicle.hear() == b"setpoint"
        assert stranger.heard_nothing()
        assert transport.refused == 3
        assert transport.contested_system_ids == {1}
    assert [record.levelname for record in caplog.records if "also heard from" in record.message] == ["WARNING"]


async def test_who_is_not_accepted_gets_no_setpoint_only_what_is_for_all(make_peer, ears, frame_by):
    """As with a signature that is not right: a vehicle whose signing clock is behind catches up by our heartbeats."""
    vehicle, stranger = make_peer(), make_peer()
    ears.refused_system_ids = {1}
    async with open_transport(LISTENING, ears) as transport:
        stranger.send(frame_by(), transport.address.port)
        await settle()
        ears.refused_system_ids = set()
        vehicle.send(frame_by(), transport.address.port)
        await ears.next()
        transport.send(b"setpoint", 1)
        transport.send(b"heartbeat")
        assert [await vehicle.hear(), await vehicle.hear()] == [b"setpoint", b"heartbeat"]
        assert await stranger.hear() == b"heartbeat"
        assert stranger.heard_nothing()


async def test_udpin_is_not_turned_away_by_somebody_who_speaks_no_mavlink(make_peer, ears, frames):
    vehicle, stranger = make_peer(), make_peer()
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3)
    junk = (
        b"",
        b"hello",
        bytes(frames[1][:-1]),
        bytes(2000),
        heartbeat.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True),
    )
    async with open_transport(LISTENING, ears) as transport:
        vehicle.send(frames[0], transport.address.port)
        await ears.next()
        for datagram in junk:
            stranger.send(datagram, transport.address.port)
        await settle()
        assert ears.empty
        assert transport.skipped_bytes == sum(map(len, junk))
        transport.send(b"heartbeat")
        assert await vehicle.hear() == b"heartbeat"
        assert stranger.heard_nothing()


async def test_a_truncated_datagram_does_not_spoil_the_next(make_peer, ears, frames):
    peer = make_peer()
    async with open_transport(LISTENING, ears) as transport:
        for datagram in (frames[0], frames[1][:-3], frames[2], frames[3] + frames[4]):
            peer.send(datagram, transport.address.port)
        assert [await ears.next() for _ in range(4)] == [frames[0], frames[2], frames[3], frames[4]]
        assert transport.skipped_bytes == len(frames[1]) - 3


async def test_a_flood_leaves_the_event_loop_its_turns(make_peer, frames):
    flooder, heard, after_each_turn = make_peer(), [], []
    async with open_transport(LISTENING, lambda frame: heard.append(frame) or True) as transport:
        for _ in range(200):
            flooder.send(frames[0] * 3, transport.address.port)
        async with asyncio.timeout(PATIENCE_S):
            while len(heard) < 600:
                await asyncio.sleep(0)
                after_each_turn.append(len(heard))
    assert max(later - earlier for earlier, later in itertools.pairwise([0, *after_each_turn])) < 300


async def test_udpout_speaks_first_and_hears_the_answer(make_peer, ears, frames):
    peer = make_peer()
    async with open_transport(LinkAddress("udpout", LOOPBACK, peer.port), ears) as transport:
        assert transport.send(bytes(frames[0]), 7)
        data, source = await asyncio.wait_for(asyncio.get_running_loop().sock_recvfrom(peer.socket, 2048), PATIENCE_S)
        assert data == frames[0]
        peer.send(frames[1], source[1])
        assert await ears.next() == frames[1]


async def test_udpout_hears_nobody_but_its_peer(make_peer, ears, frames):
    peer, stranger = make_peer(), make_peer()
    async with open_transport(LinkAddress("udpout", LOOPBACK, peer.port), ears) as transport:
        transport.send(bytes(frames[0]))
        _, source = await asyncio.wait_for(asyncio.get_running_loop().sock_recvfrom(peer.socket, 2048), PATIENCE_S)
        stranger.send(frames[1], source[1])
        peer.send(frames[2], source[1])
        assert await ears.next() == frames[2]
        assert ears.empty


async def test_udpout_to_a_closed_port_goes_on_and_the_first_frame_reaches_a_peer_that_comes_back(make_peer, ears):
    gone = make_peer()
    port = gone.port
    gone.socket.close()
    async with open_transport(LinkAddress("udpout", LOOPBACK, port), ears) as transport:
        for _ in range(50):
            transport.send(b"anyone?")
            await asyncio.sleep(0)
        transport.send(b"anyone?")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as back:
            back.bind((LOOPBACK, port))
            back.settimeout(PATIENCE_S)
            assert transport.send(b"there you are")
            assert back.recv(2048) == b"there you are"


async def test_what_the_network_does_not_take_is_lost_at_once_and_said_so(make_peer, ears):
    peer = make_peer()
    async with open_transport(LinkAddress("udpout", LOOPBACK, peer.port), ears) as transport:
        assert all(transport.send(bytes(280)) for _ in range(100))
        assert not transport.send(bytes(70_000))
    assert not transport.send(b"too late")


async def test_a_udp_link_that_cannot_be_opened_is_an_error_that_names_it(make_peer, ears):
    peer = make_peer()
    for address in (
        LinkAddress("udpin", LOOPBACK, peer.port),
        LinkAddress("udpin", "203.0.113.7", 0),
        LinkAddress("udpout", "no-such-host.invalid", 14550),
    ):
        with pytest.raises(LinkError, match=f"link {address} cannot be opened"):
            async with open_transport(address, ears):
                pass
