"""Every frame is in the .tlog as pymavlink reads it, and no disk, full or slow, is felt by the flight."""

import asyncio
import contextlib
import io
import logging
import resource
import threading

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Codec
from drivers.mavlink.signing import LinkSigner
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import SigningKey
from drivers.mavlink.tlog import TlogLimits, Tlogs, open_tlogs
from tests.fakes import FAKE_UNIX_NS, ManualClock

ADDRESS = "udpin:127.0.0.1:14550"
AT_THE_END = TlogLimits(flush_period_s=3600.0)
"""Everything is written when the tlogs close: what a test queues waits until then."""


@pytest.fixture
def clock():
    return ManualClock()


def heartbeat(mode, codec=None):
    message = mavlink.MAVLink_heartbeat_message(2, 3, 0, mode, 4, 3)
    return bytearray((codec or Codec(1, 1)).encode(message))


def read(path):
    """Return (time, message) of every record, as MAVExplorer and the like see them."""
    log = mavutil.mavlogfile(str(path), robust_parsing=False)
    try:
        return [(message._timestamp, message) for message in iter(log.recv_msg, None)]
    finally:
        log.close()


async def test_frames_come_back_through_pymavlink_in_order_with_their_times(clock, tmp_path):
    air, ground = Codec(1, 1), Codec(255, 190)
    async with open_tlogs(tmp_path, clock) as tlogs:
        log = tlogs.of(ADDRESS)
        for number in range(50):
            log.received(heartbeat(number, air))
            clock.jump(0.05)
            log.sent(bytes(heartbeat(100 + number, ground)))
            clock.jump(0.05)
    records = read(tmp_path / "udpin-127.0.0.1-14550.tlog")
    assert [message.custom_mode for _, message in records] == [n for k in range(50) for n in (k, 100 + k)]
    assert [message.get_srcSystem() for _, message in records] == [1, 255] * 50
    times = [time_s - FAKE_UNIX_NS * 1e-9 for time_s, _ in records]
    assert times == pytest.approx([0.05 * n for n in range(100)], abs=2e-6)


async def test_a_record_is_big_endian_microseconds_and_the_frame(clock, tmp_path):
    frame = heartbeat(4)
    async with open_tlogs(tmp_path, clock) as tlogs:
        tlogs.of(ADDRESS).received(frame)
    (path,) = tmp_path.iterdir()
    assert path.read_bytes() == (FAKE_UNIX_NS // 1000).to_bytes(8, "big") + frame


async def test_signed_frames_are_recorded_whole(clock, tmp_path):
    signer = LinkSigner(SigningKey(b"k" * 32), SigningClock(clock), 1, ADDRESS)
    async with open_tlogs(tmp_path, clock) as tlogs:
        for number in range(3):
            tlogs.of(ADDRESS).sent(bytes(heartbeat(number, Codec(signing=signer))))
    records = read(tmp_path / "udpin-127.0.0.1-14550.tlog")
    assert [message.custom_mode for _, message in records] == [0, 1, 2]


@pytest.mark.parametrize(
    ("address", "name"),
    [
        ("udpin:127.0.0.1:14550", "udpin-127.0.0.1-14550.tlog"),
        ("tcp:[fe80::1]:5760", "tcp-fe80-1-5760.tlog"),
        ("serial:/dev/serial/by-id/usb-FTDI_A5-if00:57600", "serial-dev-serial-by-id-usb-FTDI-A5-if00-57600.tlog"),
        ("../../etc/passwd", "etc-passwd.tlog"),
    ],
)
async def test_a_file_is_named_after_its_link(clock, tmp_path, address, name):
    async with open_tlogs(tmp_path / "run", clock) as tlogs:
        tlogs.of(address).received(heartbeat(1))
    assert [file.name for file in tmp_path.rglob("*.tlog")] == [name]


async def test_each_link_has_a_file_of_its_own_and_asking_twice_gives_the_same(clock, tmp_path):
    async with open_tlogs(tmp_path, clock) as tlogs:
        for number, address in enumerate(["tcp:a:1", "tcp:b:1", "tcp:a:1", "tcp:a_:1", "tcp:a-:1"]):
            tlogs.of(address).received(heartbeat(number))
    modes = {file.name: [m.custom_mode for _, m in read(file)] for file in tmp_path.iterdir()}
    assert modes == {"tcp-a-1.tlog": [0, 2], "tcp-b-1.tlog": [1], "tcp-a-1-2.tlog": [3], "tcp-a-1-3.tlog": [4]}


async def test_a_run_that_is_resumed_leaves_what_was_recorded(clock, tmp_path):
    for mode in (4, 5):
        async with open_tlogs(tmp_path, clock) as tlogs:
            tlogs.of(ADDRESS).received(heartbeat(mode))
    modes = {file.name: [m.custom_mode for _, m in read(file)] for file in tmp_path.iterdir()}
    assert modes == {"udpin-127.0.0.1-14550.tlog": [4], "udpin-127.0.0.1-14550-2.tlog": [5]}


async def test_a_link_that_carried_nothing_leaves_no_file(clock, tmp_path):
    async with open_tlogs(tmp_path, clock) as tlogs:
        tlogs.of(ADDRESS)
    assert list(tmp_path.iterdir()) == []


async def test_records_reach_the_disk_while_the_flight_goes_on(clock, tmp_path):
    """A killed service loses no more than the last moment."""
    async with open_tlogs(tmp_path, clock, TlogLimits(flush_period_s=0.001)) as tlogs:
        tlogs.of(ADDRESS).received(heartbeat(4))
        path = tmp_path / "udpin-127.0.0.1-14550.tlog"
        waited = threading.Event()
        for _ in range(5000):
            if path.exists() and path.stat().st_size:
                break
            waited.wait(0.001)
        assert len(read(path)) == 1


@contextlib.contextmanager
def nearly_full():
    """Writing past the 20,000th byte of any file fails, as on a full disk: pytest's own report too, so not for long."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


async def fill(tlogs):
    """Record on two links until the disk is full, and go on."""
    log, other = tlogs.of(ADDRESS), tlogs.of("tcp:a:1")
    waited = threading.Event()
    sent = 0
    while tlogs.recording and sent < 20_000:
        log.received(heartbeat(sent))
        waited.wait(0.0005)
        sent += 1
    assert not tlogs.recording
    for _ in range(1000):
        log.received(heartbeat(0))
        other.sent(bytes(heartbeat(0)))


async def test_a_full_disk_ends_the_recording_loudly_once_and_leaves_whole_records(clock, tmp_path, caplog):
    async with open_tlogs(tmp_path, clock, TlogLimits(flush_period_s=0.001)) as tlogs:
        with nearly_full():
            await fill(tlogs)
    assert "recording has ended: File too large" in tlogs.problem
    assert [record.levelno for record in caplog.records] == [logging.ERROR]
    assert caplog.records[0].message == f"{tlogs.problem}. The flight goes on"
    records = read(tmp_path / "udpin-127.0.0.1-14550.tlog")
    assert [message.custom_mode for _, message in records] == list(range(len(records)))
    assert records
    assert not (tmp_path / "tcp-a-1.tlog").exists()


async def test_a_folder_that_cannot_be_made_ends_the_recording_loudly(clock, tmp_path, caplog):
    (tmp_path / "file").write_text("")
    async with open_tlogs(tmp_path / "file" / "tlogs", clock, AT_THE_END) as tlogs:
        tlogs.of(ADDRESS).received(heartbeat(1))
    assert "recording has ended: Not a directory" in tlogs.problem
    assert str(tmp_path / "file" / "tlogs") in tlogs.problem
    assert [record.levelno for record in caplog.records] == [logging.ERROR]


async def test_the_size_limit_ends_the_recording_and_is_kept(clock, tmp_path):
    limits = TlogLimits(written_bytes=100, flush_period_s=3600.0)
    async with open_tlogs(tmp_path, clock, limits) as tlogs:
        tlogs.of("tcp:a:1").received(heartbeat(1))
        for mode in range(4):
            tlogs.of("tcp:b:1").received(heartbeat(mode))
    assert "limit of 0 MiB" in tlogs.problem
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) == 29


async def test_the_last_of_the_disk_is_left_to_others(clock, tmp_path):
    async with open_tlogs(tmp_path, clock, TlogLimits(least_free_bytes=2**62, flush_period_s=0.001)) as tlogs:
        tlogs.of(ADDRESS).received(heartbeat(1))
    assert "MiB are free on the disk" in tlogs.problem
    assert not tlogs.recording


async def test_memory_is_bounded_while_the_disk_does_not_keep_up(clock, tmp_path, caplog):
    limits = TlogLimits(waiting_bytes=2900, flush_period_s=3600.0)
    async with open_tlogs(tmp_path, clock, limits) as tlogs:
        for number in range(1000):
            tlogs.of(ADDRESS).received(heartbeat(number))
        assert tlogs.left_out == 900
        assert tlogs.recording
        assert "frames are left out: the disk does not keep up" in tlogs.problem
    assert len(caplog.records) == 1
    assert len(read(tmp_path / "udpin-127.0.0.1-14550.tlog")) == 100


class StuckFile(io.FileIO):
    """A file on a disk that has stopped answering."""

    asked, answers = threading.Event(), threading.Event()

    def write(self, data):
        self.asked.set()
        self.answers.wait(60.0)
        return super().write(data)


async def test_a_disk_that_hangs_holds_up_neither_the_links_nor_the_end_of_the_run(clock, tmp_path):
    limits = TlogLimits(flush_period_s=0.001, waiting_bytes=2900, close_timeout_s=0.05)
    tlogs = Tlogs(tmp_path, clock, limits, lambda folder, address: StuckFile(folder / "stuck", "x"))
    tlogs.start()
    log = tlogs.of(ADDRESS)
    log.received(heartbeat(0))
    assert StuckFile.asked.wait(10.0)
    for number in range(1, 1000):
        log.received(heartbeat(number))
    assert tlogs.left_out == 899
    await tlogs.close()
    assert "the disk does not answer within 0.05 s" in tlogs.problem
    StuckFile.answers.set()


async def test_a_folder_not_made_before_anything_is_recorded_is_no_failure(clock, tmp_path):
    async with open_tlogs(tmp_path / "later", clock, TlogLimits(flush_period_s=0.001)) as tlogs:
        tlogs.of(ADDRESS)
        await asyncio.sleep(0.02)
        assert tlogs.recording
        tlogs.of(ADDRESS).received(heartbeat(1))
    assert tlogs.problem is None
    assert len(read(tmp_path / "later" / "udpin-127.0.0.1-14550.tlog")) == 1
