"""A serial line over a pseudo-terminal: unplugged and plugged in again, full, noisy, held by somebody else."""

import asyncio
import contextlib
import logging
import os
import sys
import time
import tty

import pytest

from drivers.errors import LinkError
from drivers.mavlink.codec import FrameSplitter
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.transports import open_transport
from tests.drivers.mavlink.transports.hurrying import logged_by, run_hurrying, until

PATIENCE_S = 5.0
LOGGER = "drivers.mavlink.transports.retry"


class Radio:
    """The far end of a serial line. Its device is a name that comes and goes with it, as a USB device's does."""

    def __init__(self, device):
        self.device = device
        self.fd = None

    def plug_in(self):
        self.fd, near = os.openpty()
        tty.setraw(near)
        os.set_blocking(self.fd, False)
        self.device.symlink_to(os.ttyname(near))
        os.close(near)

    def unplug(self):
        self.device.unlink()
        os.close(self.fd)
        self.fd = None

    def say(self, data):
        os.write(self.fd, data)

    def take(self):
        """Return what has come in so far."""
        received = b""
        with contextlib.suppress(OSError):  # nothing there, or nobody at the other end
            while data := os.read(self.fd, 1 << 16):
                received += data
        return received

    async def hear(self, length):
        received = b""
        async with asyncio.timeout(PATIENCE_S):
            while len(received) < length:
                received += self.take()
                await asyncio.sleep(0.001)
        return received


@pytest.fixture
def radio(tmp_path):
    radio = Radio(tmp_path / "ttyUSB0")
    yield radio
    if radio.fd is not None:
        os.close(radio.fd)


@pytest.fixture
def address(radio):
    return LinkAddress("serial", str(radio.device), 57600)


async def test_frames_are_heard_however_they_are_cut_between_noise_and_sent_whole(radio, address, ears, frames):
    radio.plug_in()
    async with open_transport(address, ears) as transport:
        await until(lambda: transport.connected)
        stream = b"noise" + b"".join(bytes(frame) for frame in frames[:3])
        for piece in (stream[:9], stream[9:30], stream[30:]):
            radio.say(piece)
            await asyncio.sleep(0.005)
        assert [await ears.next() for _ in range(3)] == frames[:3]
        assert transport.skipped_bytes == 5
        assert transport.send(bytes(frames[3]), 1)
        assert await radio.hear(len(frames[3])) == frames[3]


def test_an_unplugged_device_is_found_again_and_half_a_frame_does_not_spoil_what_follows(radio, address, ears, frames):
    async def scenario():
        radio.plug_in()
        async with open_transport(address, ears) as transport:
            for frame in frames[:3]:
                await until(lambda: transport.connected)
                radio.say(bytes(frame + frames[5][:9]))
                assert await ears.next() == frame
                radio.unplug()
                await until(lambda: not transport.connected)
                assert not transport.send(b"lost")
                assert not transport.backlogged
                radio.plug_in()
            await until(lambda: transport.connected)
            assert transport.send(b"heard")
            assert await radio.hear(5) == b"heard"
            assert ears.empty

    run_hurrying(scenario())


def test_a_missing_device_is_tried_after_twice_as_long_up_to_a_cap_and_warned_of_once(radio, address, ears):
    async def scenario():
        async with open_transport(address, ears) as transport:
            for _ in range(40):
                assert not transport.connected
                await asyncio.sleep(1.0)
            radio.plug_in()
            await until(lambda: transport.connected)

    attempts = logged_by(scenario(), LOGGER)
    waits = [float(text.split("trying again in ")[1].split()[0]) for _, _, text in attempts]
    assert waits[:7] == [0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 8.0]
    assert [level for _, level, _ in attempts] == [logging.WARNING] + [logging.DEBUG] * (len(attempts) - 1)
    assert str(address) in attempts[0][2]
    assert "Is it plugged in" in attempts[0][2]


def test_a_device_that_another_program_holds_is_waited_for(radio, address, ears):
    async def scenario():
        radio.plug_in()
        async with contextlib.AsyncExitStack() as stack:
            first = await stack.enter_async_context(open_transport(address, ears))
            await until(lambda: first.connected)
            async with open_transport(address, ears) as second:
                await asyncio.sleep(1.0)
                assert not second.connected
                await stack.aclose()
                await until(lambda: second.connected)

    assert any("lock" in text for _, _, text in logged_by(scenario(), LOGGER))


async def test_a_line_that_takes_no_more_drops_frames_and_cuts_none(radio, address, ears, frame_by):
    radio.plug_in()
    loop, sent, splitter = asyncio.get_running_loop(), 0, FrameSplitter()
    async with open_transport(address, ears) as transport:
        await until(lambda: transport.connected)
        started_s = loop.time()
        for number in range(20_000):
            sent += transport.send(bytes(frame_by(system_id=1 + number % 200)))
        assert loop.time() - started_s < PATIENCE_S
        assert 0 < sent < 20_000
        taken = radio.take()
        await asyncio.sleep(0.01)
        taken += radio.take()
        assert transport.send(bytes(frame_by(system_id=250)))
        assert not transport.backlogged
        await asyncio.sleep(0.01)
        received = splitter.stream(taken + radio.take())
    assert len(received) == sent + 1
    assert received[-1][5] == 250
    assert splitter.skipped_bytes == 0


def test_a_frame_taken_in_part_is_a_backlog_until_the_rest_is_out_and_nothing_cuts_in(radio, address, ears):
    async def scenario():
        radio.plug_in()
        async with open_transport(address, ears) as transport:
            await until(lambda: transport.connected)
            sent = 0
            while not transport.backlogged:
                assert transport.send(b"." * 1000)
                sent += 1000
            taken = radio.take()
            assert not transport.send(b"too soon")
            await until(lambda: not transport.backlogged)
            assert transport.send(b"next")
            assert taken + await radio.hear(sent - len(taken) + 4) == b"." * sent + b"next"
            started_s = time.monotonic()
            await asyncio.sleep(100.0)
            assert time.monotonic() - started_s < 5.0, "an idle line kept the event loop busy"

    run_hurrying(scenario())


async def test_without_pyserial_the_error_says_what_to_install(address, ears, monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(LinkError, match=r"serial:.* needs pyserial: pip install 'bearing-relay\[serial\]'"):
        async with open_transport(address, ears):
            pass


def test_what_is_no_serial_line_is_said_and_holds_nothing_up(radio, address, ears):
    async def scenario():
        radio.device.write_text("a plain file")
        async with open_transport(address, ears) as transport:
            await asyncio.sleep(1.0)
            assert not transport.connected
        assert radio.device.read_text() == "a plain file"

    lines = logged_by(scenario(), LOGGER)
    assert "at this baud rate" in lines[0][2]
