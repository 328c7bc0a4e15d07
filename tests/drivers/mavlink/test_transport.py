"""Bytes over loopback: UDP in and out, a TCP client that comes back, and sending that never blocks nor raises."""

import asyncio
import contextlib
import itertools
import logging
import selectors
import socket
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import LinkError
from drivers.mavlink.codec import Codec
from drivers.mavlink.transport import LinkAddress, open_transport
from tests.fakes import settle

LOOPBACK = "127.0.0.1"
PATIENCE_S = 5.0
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3)
LOGGER = "drivers.mavlink.transport"


class HurryingSelector(selectors.DefaultSelector):
    """Where the event loop would wait for a timer, its time jumps there instead."""

    skipped_s = 0.0

    def select(self, timeout=None):
        if timeout is None or timeout <= 0.0:
            return super().select(timeout)
        ready = super().select(min(timeout, 0.003))
        if not ready:
            self.skipped_s += timeout
        return ready


class HurryingLoop(asyncio.SelectorEventLoop):
    """An event loop on which the longest back-off passes at once."""

    def __init__(self):
        self._hurrying = HurryingSelector()
        super().__init__(self._hurrying)

    def time(self):
        return super().time() + self._hurrying.skipped_s


def run_hurrying(scenario):
    with asyncio.Runner(loop_factory=HurryingLoop) as runner:
        return runner.run(scenario)


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


@pytest.fixture
def deaf():
    """A TCP socket on a port of its own that refuses connections until somebody listens on it."""
    with socket.socket() as holder:
        holder.bind((LOOPBACK, 0))
        yield holder


def port_of(holder):
    return holder.getsockname()[1]


@pytest.fixture
def frames():
    codec = Codec(1, 1)
    return [bytearray(codec.encode(HEARTBEAT)) for _ in range(6)]


async def soon(queue):
    return await asyncio.wait_for(queue.get(), PATIENCE_S)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udpin:0.0.0.0:14550", LinkAddress("udpin", "0.0.0.0", 14550)),
        ("udpout:companion.local:14550", LinkAddress("udpout", "companion.local", 14550)),
        (" tcp:127.0.0.1:5760 ", LinkAddress("tcp", "127.0.0.1", 5760)),
        ("tcp:[::1]:5760", LinkAddress("tcp", "::1", 5760)),
    ],
)
def test_an_address_is_read_as_written(text, address):
    assert LinkAddress.parse(text) == address


def test_an_address_is_written_as_it_is_read():
    assert str(LinkAddress.parse("udpin:127.0.0.1:14550")) == "udpin:127.0.0.1:14550"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "14550",
        "udpin:14550",
        "udp:127.0.0.1:14550",
        "UDPIN:127.0.0.1:14550",
        "udpin:127.0.0.1:65536",
        "udpin:127.0.0.1:-1",
        "udpin:127.0.0.1:",
        "udpin::14550",
        "udpin:12 7:1",
        "tcp:a:b:1",
        "/dev/ttyACM0",
        "udpin:127.0.0.1:14550:57600",
    ],
)
def test_anything_else_is_refused_with_what_is_allowed(text):
    with pytest.raises(LinkError, match="is not SCHEME:HOST:PORT with a scheme of udpin, udpout, tcp") as caught:
        LinkAddress.parse(text)
    assert repr(text) in str(caught.value)


async def test_udpin_is_silent_until_spoken_to_then_answers_whoever_spoke_last(make_peer, frames):
    heard, first, second = asyncio.Queue(), make_peer(), make_peer()
    async with open_transport(LinkAddress("udpin", LOOPBACK, 0), heard.put_nowait) as transport:
        port = transport.address.port
        transport.send(b"to nobody")
        first.send(frames[0], port)
        assert await soon(heard) == frames[0]
        transport.send(b"to the first")
        assert await first.hear() == b"to the first"
        second.send(frames[1], port)
        assert await soon(heard) == frames[1]
        transport.send(b"to the second")
        assert await second.hear() == b"to the second"
        assert first.heard_nothing()


async def test_udpin_is_not_turned_away_by_somebody_who_speaks_no_mavlink(make_peer, frames):
    heard, vehicle, stranger = asyncio.Queue(), make_peer(), make_peer()
    async with open_transport(LinkAddress("udpin", LOOPBACK, 0), heard.put_nowait) as transport:
        vehicle.send(frames[0], transport.address.port)
        await soon(heard)
        for junk in (
            b"",
            b"hello",
            bytes(frames[1][:-1]),
            bytes(2000),
            HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True),
        ):
            stranger.send(junk, transport.address.port)
        await settle()
        assert heard.empty()
        transport.send(b"to the vehicle")
        assert await vehicle.hear() == b"to the vehicle"
        assert stranger.heard_nothing()


async def test_a_truncated_datagram_does_not_spoil_the_next(make_peer, frames):
    heard, peer = asyncio.Queue(), make_peer()
    async with open_transport(LinkAddress("udpin", LOOPBACK, 0), heard.put_nowait) as transport:
        for datagram in (frames[0], frames[1][:-3], frames[2], frames[3] + frames[4]):
            peer.send(datagram, transport.address.port)
        assert [await soon(heard) for _ in range(4)] == [frames[0], frames[2], frames[3], frames[4]]


async def test_udpout_speaks_first_and_hears_the_answer(make_peer, frames):
    heard, peer = asyncio.Queue(), make_peer()
    async with open_transport(LinkAddress("udpout", LOOPBACK, peer.port), heard.put_nowait) as transport:
        transport.send(bytes(frames[0]))
        data, source = await asyncio.wait_for(asyncio.get_running_loop().sock_recvfrom(peer.socket, 2048), PATIENCE_S)
        assert data == frames[0]
        peer.send(frames[1], source[1])
        assert await soon(heard) == frames[1]


async def test_udpout_to_a_closed_port_goes_on_and_reaches_a_peer_that_comes_back(make_peer):
    gone = make_peer()
    port = gone.port
    gone.socket.close()
    async with open_transport(LinkAddress("udpout", LOOPBACK, port), lambda _: None) as transport:
        for _ in range(50):
            transport.send(b"anyone?")
            await asyncio.sleep(0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as back:
            back.bind((LOOPBACK, port))
            back.settimeout(PATIENCE_S)
            transport.send(b"lost to the pending error")
            transport.send(b"there you are")
            assert back.recv(2048) in (b"lost to the pending error", b"there you are")


async def test_sending_on_a_closed_or_overfilled_udp_link_raises_nothing(make_peer):
    peer = make_peer()
    async with open_transport(LinkAddress("udpout", LOOPBACK, peer.port), lambda _: None) as transport:
        for _ in range(2000):
            transport.send(bytes(280))
        transport.send(bytes(70_000))
        await asyncio.sleep(0)
    transport.send(b"too late")


async def test_a_udp_link_that_cannot_be_opened_is_an_error_that_names_it(make_peer):
    peer = make_peer()
    for address in (LinkAddress("udpin", LOOPBACK, peer.port), LinkAddress("udpin", "203.0.113.7", 0)):
        with pytest.raises(LinkError, match=f"link {address} cannot be opened"):
            async with open_transport(address, lambda _: None):
                pass


class Server:
    """A TCP autopilot: every connection is handed to the test."""

    def __init__(self):
        self.connections = asyncio.Queue()

    @contextlib.asynccontextmanager
    async def listening(self, **where):
        opened = []

        def accept(reader, writer):
            opened.append(writer)
            self.connections.put_nowait((reader, writer))

        server = await asyncio.start_server(accept, **(where or {"host": LOOPBACK, "port": 0}))
        try:
            yield server.sockets[0].getsockname()[1]
        finally:
            server.close()
            for writer in opened:
                writer.close()


async def test_tcp_hears_frames_however_the_stream_is_cut_and_sends_its_own(frames):
    heard, server = asyncio.Queue(), Server()
    async with (
        server.listening() as port,
        open_transport(LinkAddress("tcp", LOOPBACK, port), heard.put_nowait) as transport,
    ):
        reader, writer = await soon(server.connections)
        stream = b"".join(bytes(frame) for frame in frames[:3])
        for piece in (stream[:5], stream[5:30], stream[30:]):
            writer.write(piece)
            await writer.drain()
        assert [await soon(heard) for _ in range(3)] == frames[:3]
        transport.send(bytes(frames[3]))
        assert await asyncio.wait_for(reader.readexactly(len(frames[3])), PATIENCE_S) == frames[3]


def test_tcp_comes_back_after_the_peer_closes_and_half_a_frame_does_not_spoil_the_next_connection(frames):
    async def scenario():
        heard, server = asyncio.Queue(), Server()
        async with (
            server.listening() as port,
            open_transport(LinkAddress("tcp", LOOPBACK, port), heard.put_nowait) as transport,
        ):
            for number in range(3):
                reader, writer = await soon(server.connections)
                writer.write(bytes(frames[number] + frames[5][:9]))
                assert await soon(heard) == frames[number]
                transport.send(bytes(frames[4]))
                assert await asyncio.wait_for(reader.readexactly(len(frames[4])), PATIENCE_S) == frames[4]
                writer.close()
            assert heard.empty()

    run_hurrying(scenario())


def test_tcp_comes_back_after_a_reset_and_what_is_sent_meanwhile_is_lost_without_an_error():
    async def scenario():
        server = Server()
        async with (
            server.listening() as port,
            open_transport(LinkAddress("tcp", LOOPBACK, port), lambda _: None) as transport,
        ):
            _, writer = await soon(server.connections)
            writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            writer.close()
            for _ in range(100):
                transport.send(b"lost")
                await asyncio.sleep(0)
            reader, _ = await soon(server.connections)
            transport.send(b"heard")
            assert await asyncio.wait_for(reader.readexactly(5), PATIENCE_S) == b"heard"

    run_hurrying(scenario())


def attempts_of(scenario):
    """Return (time, level, text) of everything a TCP link logs while a scenario runs."""
    records = []

    class Recorder(logging.Handler):
        def emit(self, record):
            records.append((asyncio.get_running_loop().time(), record.levelno, record.getMessage()))

    logger, recorder = logging.getLogger(LOGGER), Recorder()
    level = logger.level
    logger.addHandler(recorder)
    logger.setLevel(logging.DEBUG)
    try:
        run_hurrying(scenario)
    finally:
        logger.removeHandler(recorder)
        logger.setLevel(level)
    return records


def test_a_refused_tcp_connection_is_tried_again_after_twice_as_long_up_to_a_cap_and_warned_of_once(deaf):
    async def scenario():
        async with open_transport(LinkAddress("tcp", LOOPBACK, port_of(deaf)), lambda _: None) as transport:
            for _ in range(60):
                transport.send(b"lost")
                await asyncio.sleep(1.0)

    attempts = attempts_of(scenario())
    times = [time_s for time_s, _, _ in attempts]
    waits = [later - earlier for earlier, later in itertools.pairwise(times)]
    assert waits[:8] == pytest.approx([0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 8.0, 8.0], abs=0.1)
    levels = [level for _, level, _ in attempts]
    assert levels == [logging.WARNING] + [logging.DEBUG] * (len(levels) - 1)
    assert f"tcp:127.0.0.1:{port_of(deaf)}" in attempts[0][2]


def test_after_a_connection_the_waits_start_short_again(deaf):
    async def scenario():
        server, loop = Server(), asyncio.get_running_loop()
        async with open_transport(LinkAddress("tcp", LOOPBACK, port_of(deaf)), lambda _: None):
            await asyncio.sleep(30.0)
            async with server.listening(sock=deaf):
                closed_s = loop.time()
                for _ in range(4):
                    _, writer = await server.connections.get()
                    waits.append(loop.time() - closed_s)
                    writer.close()
                    closed_s = loop.time()

    waits = []
    run_hurrying(scenario())
    assert waits[0] <= 8.0
    assert waits[1:] == pytest.approx([0.5, 0.5, 0.5], abs=0.1)


async def test_a_tcp_peer_that_does_not_read_is_not_waited_for():
    frame, count = bytes(1000), 20_000
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        listener.bind((LOOPBACK, 0))
        listener.listen()
        listener.settimeout(0.0)
        address = LinkAddress("tcp", LOOPBACK, listener.getsockname()[1])
        loop, received = asyncio.get_running_loop(), bytearray()
        async with open_transport(address, lambda _: None) as transport:
            peer, _ = await asyncio.wait_for(loop.sock_accept(listener), PATIENCE_S)
            with peer:
                while not received:  # until the link has noticed that it is connected
                    transport.send(frame)
                    await asyncio.sleep(0)
                    with contextlib.suppress(BlockingIOError):
                        received += peer.recv(1 << 20)
                started_s = loop.time()
                for _ in range(count):
                    transport.send(frame)
                assert loop.time() - started_s < 2.0
                transport.send(b"lost with the rest")
                with contextlib.suppress(TimeoutError):
                    while data := await asyncio.wait_for(loop.sock_recv(peer, 1 << 20), 0.3):
                        received += data
        assert 0 < len(received) < count * len(frame)
        assert len(received) % len(frame) == 0, "a frame was cut"


async def test_a_tcp_link_that_never_connected_ends_at_once_with_its_block(deaf):
    started_s = asyncio.get_running_loop().time()
    async with open_transport(LinkAddress("tcp", LOOPBACK, port_of(deaf)), lambda _: None) as transport:
        transport.send(b"lost")
        await asyncio.sleep(0)
    assert asyncio.get_running_loop().time() - started_s < 0.4
