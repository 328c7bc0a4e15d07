"""TCP over loopback: it comes back by itself, and no setpoint waits in a connection that is dead."""

import asyncio
import contextlib
import itertools
import logging
import socket
import struct

import pytest

from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.transports import open_transport
from drivers.mavlink.transports.tcp import BACKLOG_S, SILENT_S, STALLED_S
from tests.drivers.mavlink.transports.hurrying import logged_by, run_hurrying, until, waited_s

LOOPBACK = "127.0.0.1"
PATIENCE_S = 5.0
LOGGER = "drivers.mavlink.transports.retry"


@pytest.fixture
def deaf():
    """A TCP socket on a port of its own that refuses connections until somebody listens on it."""
    with socket.socket() as holder:
        holder.bind((LOOPBACK, 0))
        yield holder


def at(port):
    return LinkAddress("tcp", LOOPBACK, port)


def port_of(holder):
    return holder.getsockname()[1]


class Server:
    """A TCP autopilot: every connection is handed to the test."""

    def __init__(self):
        self._connections = asyncio.Queue()

    async def connection(self):
        return await asyncio.wait_for(self._connections.get(), 100.0)

    @contextlib.asynccontextmanager
    async def listening(self, **where):
        opened = []

        def accept(reader, writer):
            opened.append(writer)
            self._connections.put_nowait((reader, writer))

        server = await asyncio.start_server(accept, **(where or {"host": LOOPBACK, "port": 0}))
        try:
            yield server.sockets[0].getsockname()[1]
        finally:
            server.close()
            for writer in opened:
                writer.close()


async def test_tcp_hears_frames_however_the_stream_is_cut_and_sends_its_own(ears, frames):
    server = Server()
    async with server.listening() as port, open_transport(at(port), ears) as transport:
        reader, writer = await server.connection()
        stream = b"".join(bytes(frame) for frame in frames[:3])
        for piece in (stream[:5], stream[5:30], stream[30:]):
            writer.write(piece)
            await writer.drain()
        assert [await ears.next() for _ in range(3)] == frames[:3]
        assert transport.send(bytes(frames[3]), 1)
        assert await asyncio.wait_for(reader.readexactly(len(frames[3])), PATIENCE_S) == frames[3]


def test_it_comes_back_after_the_peer_closes_and_half_a_frame_does_not_spoil_the_next_connection(ears, frames):
    async def scenario():
        server = Server()
        async with server.listening() as port, open_transport(at(port), ears) as transport:
            for number in range(3):
                reader, writer = await server.connection()
                writer.write(b"noise" + bytes(frames[number] + frames[5][:9]))
                assert await ears.next() == frames[number]
                transport.send(bytes(frames[4]))
                assert await asyncio.wait_for(reader.readexactly(len(frames[4])), PATIENCE_S) == frames[4]
                writer.close()
            assert ears.empty
            assert transport.skipped_bytes == 3 * len(b"noise")

    run_hurrying(scenario())


def test_it_comes_back_after_a_reset_and_what_is_sent_meanwhile_is_lost_without_an_error(ears):
    async def scenario():
        server = Server()
        async with server.listening() as port, open_transport(at(port), ears) as transport:
            _, writer = await server.connection()
            await until(lambda: transport.connected)
            writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            writer.close()
            await until(lambda: not transport.connected)
            assert not transport.send(b"lost")
            reader, _ = await server.connection()
            await until(lambda: transport.connected)
            transport.send(b"heard")
            assert await asyncio.wait_for(reader.readexactly(5), PATIENCE_S) == b"heard"

    run_hurrying(scenario())


def test_a_refused_connection_is_tried_again_after_twice_as_long_up_to_a_cap_and_warned_of_once(deaf, ears):
    async def scenario():
        async with open_transport(at(port_of(deaf)), ears) as transport:
            for _ in range(60):
                assert not transport.send(b"lost")
                assert not transport.connected
                await asyncio.sleep(1.0)

    attempts = logged_by(scenario(), LOGGER)
    times = [time_s for time_s, _, _ in attempts]
    waits = [later - earlier for earlier, later in itertools.pairwise(times)]
    assert waits[:8] == pytest.approx([0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 8.0, 8.0], abs=0.1)
    levels = [level for _, level, _ in attempts]
    assert levels == [logging.WARNING] + [logging.DEBUG] * (len(levels) - 1)
    assert f"tcp:127.0.0.1:{port_of(deaf)}" in attempts[0][2]


@pytest.mark.parametrize(("speaks", "waits"), [(True, [0.5, 0.5, 0.5]), (False, [8.0, 8.0, 8.0])])
def test_the_waits_start_short_again_once_something_was_heard_and_not_before(deaf, ears, frames, speaks, waits):
    """A port that takes connections and closes them is no autopilot."""
    waited = []

    async def scenario():
        server, loop = Server(), asyncio.get_running_loop()
        async with open_transport(at(port_of(deaf)), ears):
            await asyncio.sleep(30.0)
            async with server.listening(sock=deaf):
                closed_s = loop.time()
                for _ in range(4):
                    _, writer = await server.connection()
                    waited.append(loop.time() - closed_s)
                    if speaks:
                        writer.write(bytes(frames[0]))
                        await ears.next()
                    writer.close()
                    closed_s = loop.time()

    run_hurrying(scenario())
    assert waited[0] <= 8.0
    assert waited[1:] == pytest.approx(waits, abs=0.2)


def test_a_connection_on_which_nothing_is_heard_any_more_is_made_anew(ears, frames):
    """As when the other side was stopped, or its power cut: nobody closes the connection."""

    async def scenario():
        server, loop = Server(), asyncio.get_running_loop()
        async with server.listening() as port, open_transport(at(port), ears):
            _, writer = await server.connection()
            for frame in frames:  # heard for longer than it may be silent
                writer.write(bytes(frame))
                await ears.next()
                await asyncio.sleep(SILENT_S / 3)
            silent_s = loop.time()
            await server.connection()
            assert SILENT_S / 2 < loop.time() - silent_s < SILENT_S + 2.0

    lines = logged_by(scenario(), LOGGER)
    assert [text.split(": ")[1].split(";")[0] for _, _, text in lines] == [f"nothing heard for {SILENT_S:g} s"]


@contextlib.asynccontextmanager
async def unread_peer(ears):
    """Yield a transport, and the other end of its connection with little room and nobody who reads."""
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        listener.bind((LOOPBACK, 0))
        listener.listen()
        listener.settimeout(0.0)
        async with open_transport(at(port_of(listener)), ears) as transport:
            peer, _ = await asyncio.wait_for(asyncio.get_running_loop().sock_accept(listener), PATIENCE_S)
            with peer:
                peer.settimeout(0.0)
                await until(lambda: transport.connected)
                yield transport, peer, listener


async def rest_of(peer):
    received = bytearray()
    with contextlib.suppress(TimeoutError, ConnectionResetError):
        while data := await asyncio.wait_for(asyncio.get_running_loop().sock_recv(peer, 1 << 20), 0.3):
            received += data
    return received


async def test_a_peer_that_does_not_read_is_not_waited_for(ears):
    frame, count, loop = bytes(1000), 20_000, asyncio.get_running_loop()
    async with unread_peer(ears) as (transport, peer, _):
        started_s = loop.time()
        sent = sum(transport.send(frame) for _ in range(count))
        assert loop.time() - started_s < 2.0
        assert not transport.send(b"lost with the rest")
        received = await rest_of(peer)
    assert 0 < sent < count
    assert len(received) == sent * len(frame), "a frame was cut"


def test_a_connection_that_stalls_is_backlogged_then_dropped_with_what_waits_in_it(ears, frames):
    """The peer still speaks, so it is there; but what it gets would be seconds old."""

    async def scenario():
        loop = asyncio.get_running_loop()
        async with unread_peer(ears) as (transport, peer, listener):
            assert not transport.backlogged
            sent, stalled_s, backlogged_s = 0, loop.time(), None
            while transport.send(bytes(1000)):
                sent += 1000
            while transport.connected:
                if transport.backlogged and backlogged_s is None:
                    backlogged_s = loop.time()
                with contextlib.suppress(OSError):
                    peer.send(frames[0])
                await asyncio.sleep(0.05)
            assert backlogged_s is not None, "it was dropped unannounced"
            assert backlogged_s - stalled_s >= BACKLOG_S
            assert loop.time() - stalled_s >= STALLED_S
            assert not transport.backlogged
            again, _ = await asyncio.wait_for(loop.sock_accept(listener), 100.0)
            with again:
                await until(lambda: transport.connected)
                assert transport.send(b"fresh")
                assert await asyncio.wait_for(loop.sock_recv(again, 1 << 20), PATIENCE_S) == b"fresh"
            assert len(await rest_of(peer)) < sent / 2, "the dropped connection delivered what waited in it"

    run_hurrying(scenario())


def test_a_connection_that_is_only_slow_is_neither_backlogged_nor_dropped(ears, frames):
    async def scenario():
        async with unread_peer(ears) as (transport, peer, _):
            while transport.send(bytes(1000)):
                pass
            for _ in range(100):
                await asyncio.sleep(0.1)
                peer.send(frames[0])
                with contextlib.suppress(BlockingIOError):
                    peer.recv(20_000)
                transport.send(bytes(1000))
                assert transport.connected
                assert not transport.backlogged

    run_hurrying(scenario())


async def test_a_host_nobody_knows_holds_nothing_up(ears):
    loop = asyncio.get_running_loop()
    async with open_transport(LinkAddress("tcp", "no-such-host.invalid", 5760), ears) as transport:
        began_s = loop.time()
        for _ in range(20):
            assert not transport.send(b"lost")
            await asyncio.sleep(0.005)
    assert loop.time() - began_s < 2.0


def test_a_link_that_never_connected_ends_at_once_with_its_block(deaf, ears):
    async def scenario():
        async with open_transport(at(port_of(deaf)), ears) as transport:
            transport.send(b"lost")
            await asyncio.sleep(0)
        assert waited_s() < 0.4

    run_hurrying(scenario())
