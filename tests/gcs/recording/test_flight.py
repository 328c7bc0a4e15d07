"""flight.mcap: every message once, valid by its schema, in order; and a disk that fails, which no flight notices."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import random
import resource
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import (
    Bearing,
    BearingReport,
    ControlReply,
    ControlRequest,
    Emission,
    PositionReport,
    Progress,
    encode,
    json_schemas,
)
from drivers.bus.session import BusEndpoint, open_bus
from drivers.simulation.launcher import free_tcp_port
from gcs.recording.flight import MOST_KEYS, QUEUE_BYTES, Recording, open_recording
from gcs.recording.mcap_file import McapFiles, SizeLimits
from gcs.recording.mcap_reading import parts_of, read_flight
from gcs.recording.topics import MESSAGES, decoded, every_message, schema_of
from gcs.traced_monitor import MonitorNote
from tests.fakes import FAKE_UNIX_NS, ManualClock

KEYS = SwarmKeys("test")


class Everything:
    """A bus whose one subscriber hears whatever is put."""

    def __init__(self) -> None:
        self.hear: Callable[[str, bytes], None] = lambda key, payload: None

    def subscribe(self, key_expression: str, handler: Callable[[str, bytes], None]) -> None:
        assert key_expression == every_message(KEYS)
        self.hear = handler


class SetBackClock(ManualClock):
    """A clock whose time of day is set back now and then."""

    set_back_ns = 0

    def unix_ns(self) -> int:
        return int(super().unix_ns()) - self.set_back_ns


def report(sequence: int, captured_ns: int = FAKE_UNIX_NS) -> bytes:
    bearings = [Bearing("L0", 1.0, 0.002), Bearing("L1", -2.0, 0.002)]
    return encode(BearingReport(captured_ns, sequence, "true_north", bearings))


def position(north_m: float) -> bytes:
    return encode(PositionReport(FAKE_UNIX_NS, north_m, 2.0, -20.0, 0.0, 0.0))


def read(path: Path) -> Iterator[tuple[str, Any, int, Any]]:
    """Yield (topic, schema or None, log time, message) of every message."""
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert channel.message_encoding == "json"
            form = None if schema is None else json.loads(schema.data)
            assert schema is None or schema.encoding == "jsonschema"
            yield channel.topic, form, message.log_time, json.loads(message.data)


def traffic(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "traffic.json").read_text())
    return found


@contextlib.contextmanager
def largest_file(size_bytes: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size: writing more fails, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


async def test_what_came_last_before_a_silence_is_in_the_file_long_before_anything_follows(tmp_path: Path) -> None:
    """A service that is killed in a silence has lost nothing."""
    bus, clock = Everything(), ManualClock()
    async with open_recording(tmp_path, bus, KEYS, clock, pytest.fail):
        for north_m in (1.0, 2.0):
            bus.hear(KEYS.position("U1"), position(north_m))
            await clock.advance(0.01)
        async with asyncio.timeout(20.0):
            while not parts_of(tmp_path) or len(list(read_flight(tmp_path, lambda _: None))) < 2:
                await asyncio.sleep(0.02)
                await clock.advance(0.02)


async def test_every_message_comes_out_once_valid_and_in_order(tmp_path: Path) -> None:
    bus, clock, said = Everything(), ManualClock(), []
    sent = []
    async with open_recording(tmp_path, bus, KEYS, clock, said.append):
        for number in range(100):
            sent += [
                (KEYS.bearings("U1"), report(number, clock.unix_ns() - 100_000_000)),
                (KEYS.position("U1"), position(float(number))),
                (KEYS.emission("L0"), encode(Emission(on=number % 2 == 0))),
                (KEYS.progress, encode(Progress(clock.unix_ns(), "U1", "LEG_1", 'a "reason" with <tags> and ü'))),
            ]
            for key, payload in sent[-4:]:
                bus.hear(key, payload)
            await clock.advance(0.1)
    found = list(read(tmp_path / "flight.mcap"))
    assert [(topic, message) for topic, _, _, message in found] == [(key, json.loads(load)) for key, load in sent]
    times = [time_ns for _, _, time_ns, _ in found]
    assert times == sorted(times)
    assert times[0] == FAKE_UNIX_NS
    assert times[-1] == FAKE_UNIX_NS + 9_900_000_000
    for _, schema, _, message in found[:40]:
        jsonschema.validate(message, schema)
    assert said == []


async def test_a_clock_set_back_in_flight_sets_no_message_back(tmp_path: Path) -> None:
    bus, clock = Everything(), SetBackClock()
    async with open_recording(tmp_path, bus, KEYS, clock, print):
        for number in range(3):
            bus.hear(KEYS.bearings("U1"), report(number))
            await clock.advance(1.0)
            clock.set_back_ns += 3_600_000_000_000
    assert [time_ns - FAKE_UNIX_NS for _, _, time_ns, _ in read(tmp_path / "flight.mcap")] == [0, 10**9, 2 * 10**9]


async def test_a_real_bus_gives_back_what_the_service_itself_says_and_what_others_say_once(tmp_path: Path) -> None:
    endpoint, clock, said = f"tcp/127.0.0.1:{free_tcp_port()}", ManualClock(), []
    async with contextlib.AsyncExitStack() as stack:
        await stack.enter_async_context(open_bus(BusEndpoint(endpoint, role="router")))
        own, other = [await stack.enter_async_context(open_bus(BusEndpoint(endpoint))) for _ in range(2)]
        recording = await stack.enter_async_context(open_recording(tmp_path, own, KEYS, clock, said.append))
        probe, probed = KEYS.bearings("probe"), []
        own.subscribe(KEYS.every_bearings, lambda key, payload: probed.append(key))
        while not probed:  # by then the other side knows who listens
            other.put_reliably(probe, report(0))
            await asyncio.sleep(0.02)
        for number in range(20):
            own.put_latest(KEYS.position("U1"), position(float(number)))
            own.put_reliably(KEYS.progress, encode(Progress(number, "U1", "LEG_1", "")))
            other.put_reliably(KEYS.bearings("U1"), report(number))
            other.put_reliably("bearing-relay/another/uav/U1/bearings", report(number))
        for _ in range(500):
            if sum(of.messages for key, of in list(recording.traffic.keys.items()) if key != probe) >= 60:
                break
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.1)  # any message that comes twice comes now
    found = list(read(tmp_path / "flight.mcap"))
    assert [m["north_m"] for topic, _, _, m in found if topic == KEYS.position("U1")] == list(range(20))
    assert [m["time_ns"] for topic, _, _, m in found if topic == KEYS.progress] == list(range(20))
    assert [m["sequence"] for topic, _, _, m in found if topic == KEYS.bearings("U1")] == list(range(20))
    assert len([topic for topic, *_ in found if topic != probe]) == 60
    assert said == []


async def test_a_payload_that_is_no_message_is_kept_aside_as_it_came(tmp_path: Path) -> None:
    bus = Everything()
    async with open_recording(tmp_path, bus, KEYS, ManualClock(), print):
        bus.hear(KEYS.bearings("U1"), b"\xff\x00{")
        bus.hear(KEYS.bearings("U1"), report(1))
    (bad, form, _, kept), (good, _, _, _) = read(tmp_path / "flight.mcap")
    assert (bad, good) == (KEYS.bearings("U1") + "/unreadable", KEYS.bearings("U1"))
    assert base64.b64decode(kept["payload"]) == b"\xff\x00{"
    assert kept["problem"]
    jsonschema.validate(kept, form)
    assert traffic(tmp_path)["keys"][KEYS.bearings("U1")]["unreadable"] == 1


async def test_a_message_of_a_kind_nobody_knows_is_recorded_without_a_schema(tmp_path: Path) -> None:
    bus = Everything()
    async with open_recording(tmp_path, bus, KEYS, ManualClock(), print):
        bus.hear("bearing-relay/test/uav/U1/weather", b'{"wind_mps": 3}')
    assert [(topic, form, message) for topic, form, _, message in read(tmp_path / "flight.mcap")] == [
        ("bearing-relay/test/uav/U1/weather", None, {"wind_mps": 3})
    ]


def test_every_message_of_the_bus_has_a_key_and_a_schema_with_an_object_at_its_root() -> None:
    known = {message.__name__ for message in MESSAGES.values()}
    assert known == {entry["$ref"].rpartition("/")[2] for entry in json_schemas()["anyOf"]}
    for message in MESSAGES.values():
        schema = json.loads(schema_of(message))
        jsonschema.Draft202012Validator.check_schema(schema)
        assert schema["type"] == "object"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"captured_ns": 1}, json.loads(schema_of(BearingReport)))


async def test_what_comes_after_the_end_is_nobody_s(tmp_path: Path) -> None:
    bus, said = Everything(), []
    async with open_recording(tmp_path, bus, KEYS, ManualClock(), said.append) as recording:
        bus.hear(KEYS.bearings("U1"), report(0))
    for number in range(1, 30_000):
        bus.hear(KEYS.bearings("U1"), report(number))
    assert [message["sequence"] for _, _, _, message in read(tmp_path / "flight.mcap")] == [0]
    assert (recording.dropped, said) == (0, [])


async def test_what_the_operator_asks_and_is_answered_is_recorded(tmp_path: Path) -> None:
    request, reply = encode(ControlRequest("hold")), encode(ControlReply(ok=True, message="held"))
    async with open_recording(tmp_path, Everything(), KEYS, ManualClock(), print) as recording:
        recording.note_control(KEYS, request, reply)
    found = [(topic, schema["title"], message) for topic, schema, _, message in read(tmp_path / "flight.mcap")]
    assert found == [
        ("bearing-relay/test/relay/control/request", "ControlRequest", {"verb": "hold"}),
        ("bearing-relay/test/relay/control/reply", "ControlReply", {"ok": True, "message": "held"}),
    ]


async def test_what_stop_monitors_decide_is_recorded_beside_what_is_said(tmp_path: Path) -> None:
    """It never was on the bus: it is no traffic, and no key of the bus can be taken for it."""
    bus, note = Everything(), MonitorNote(4, 0.1 + 0.2, commanded_mps=(1.0 / 3.0, -0.0))
    async with open_recording(tmp_path, bus, KEYS, ManualClock(), print) as recording:
        recording.note_monitor("U1", note)
        bus.hear("bearing-relay/test/monitor/U1", encode(note))
    (noted, forged) = read(tmp_path / "flight.mcap")
    assert (noted[0], noted[1]["title"]) == ("monitor/U1", "MonitorNote")
    assert decoded(json.dumps(noted[3]).encode(), noted[0]) == note
    jsonschema.validate(noted[3], noted[1])
    assert forged[:2] == ("bearing-relay/test/monitor/U1", None)
    assert list(traffic(tmp_path)["keys"]) == ["bearing-relay/test/monitor/U1"]


async def test_traffic_says_how_steadily_the_sensors_reported(tmp_path: Path) -> None:
    bus, clock = Everything(), ManualClock()
    async with open_recording(tmp_path, bus, KEYS, clock, print):
        for number in (0, 1, 2, 5, 6):
            bus.hear(KEYS.bearings("U1"), report(number, clock.unix_ns() - (400 if number == 5 else 100) * 1_000_000))
            await clock.advance(0.8 if number == 2 else 0.1)
    found = traffic(tmp_path)
    assert found["files"] == ["flight.mcap"]
    assert (found["dropped"], found["stopped"]) == (0, None)
    assert found["keys"][KEYS.bearings("U1")] == {
        "messages": 5,
        "unreadable": 0,
        "size_bytes": 5 * len(report(0)),
        "rate_hz": pytest.approx(4 / 1.1),
        "longest_gap_s": pytest.approx(0.8),
    }
    assert found["sensors"]["U1"] == {
        "reports": 5,
        "bearings": 10,
        "missing": 2,
        "mean_age_s": pytest.approx(0.16),
        "longest_age_s": pytest.approx(0.4),
    }


async def test_a_full_disk_stops_the_recording_loudly_and_nothing_else(tmp_path: Path) -> None:
    bus, clock, said = Everything(), ManualClock(), []
    incompressible = random.Random(1)
    with largest_file(20_000):
        async with open_recording(tmp_path, bus, KEYS, clock, said.append):
            for _ in range(1_000):
                bus.hear(KEYS.bearings("U1"), report(incompressible.getrandbits(60)))
                await clock.advance(0.5)
        await asyncio.sleep(0)
    (message,) = said
    assert "File too large" in message
    assert "the flight goes on" in message
    assert (tmp_path / "flight.mcap").stat().st_size <= 20_000
    found = traffic(tmp_path)
    assert "File too large" in found["stopped"]
    assert found["keys"][KEYS.bearings("U1")]["messages"] == 1_000
    assert 50 < sum(1 for _ in readable(tmp_path / "flight.mcap")) < 1_000


def readable(path: Path) -> Iterator[Message]:
    """Yield the messages of a file that breaks off somewhere."""
    with path.open("rb") as stream, contextlib.suppress(EndOfFile):
        yield from (record for record in StreamReader(stream).records if isinstance(record, Message))


async def test_a_folder_that_has_gone_is_said_once_and_not_raised(tmp_path: Path) -> None:
    bus, said = Everything(), []
    folder = tmp_path / "gone"
    async with open_recording(folder, bus, KEYS, ManualClock(), said.append) as recording:
        for number in range(5):
            bus.hear(KEYS.bearings("U1"), report(number))
    await asyncio.sleep(0)
    assert recording.traffic.keys[KEYS.bearings("U1")].messages == 5
    assert any("recording has stopped, the flight goes on" in message for message in said)
    assert sum("flight.mcap" in message for message in said) == 1


def test_a_full_file_is_followed_by_another_each_complete(tmp_path: Path) -> None:
    files = McapFiles(tmp_path, {}, SizeLimits(part_bytes=3_000, total_bytes=10**9, reserve_bytes=0))
    for number in range(200):
        files.write(KEYS.bearings("U1"), BearingReport, number * 10**9, report(number))
    files.finish()
    assert len(files.paths) > 3
    assert [path.name for path in files.paths[:3]] == ["flight.mcap", "flight-2.mcap", "flight-3.mcap"]
    sequences = [message["sequence"] for path in files.paths for _, _, _, message in read(path)]
    assert sequences == list(range(200))
    assert all(path.stat().st_size < 6_000 for path in files.paths)


def fill(files: McapFiles, numbers: Iterator[int]) -> None:
    for number in numbers:
        files.write(KEYS.bearings("U1"), BearingReport, number * 10**9, report(number))


@pytest.mark.parametrize(
    ("limits", "free", "expected"),
    [
        (SizeLimits(part_bytes=3_000, total_bytes=9_000, reserve_bytes=0), [10**9] * 99, "has reached its"),
        (SizeLimits(reserve_bytes=1_000), [10**9] * 30 + [999] * 99, "left on the disk, which the journal needs"),
    ],
)
def test_a_limit_ends_the_recording_with_complete_files(
    tmp_path: Path, limits: SizeLimits, free: list[int], expected: str
) -> None:
    left = iter(free)
    files = McapFiles(tmp_path, {}, limits, free_bytes=lambda folder: next(left))
    numbers = iter(range(1_000))
    with pytest.raises(OSError, match=expected):
        fill(files, numbers)
    written = next(numbers)
    sequences = [message["sequence"] for path in files.paths for _, _, _, message in read(path)]
    assert sequences == list(range(written))
    assert sum(path.stat().st_size for path in files.paths) < 20_000


def test_a_recording_resumed_in_its_folder_overwrites_nothing(tmp_path: Path) -> None:
    for start in (0, 10):
        files = McapFiles(tmp_path, {}, SizeLimits(reserve_bytes=0))
        files.write(KEYS.bearings("U1"), BearingReport, start, report(start))
        files.finish()
    assert [m["sequence"] for name in ("flight", "flight-2") for _, _, _, m in read(tmp_path / f"{name}.mcap")] == [
        0,
        10,
    ]


def test_what_the_disk_is_too_slow_for_is_dropped_counted_and_said_once(tmp_path: Path) -> None:
    said: list[str] = []
    recording = Recording(McapFiles(tmp_path, {}, SizeLimits()), ManualClock(), said.append, queue_length=10)
    for number in range(25):
        recording.note(KEYS.bearings("U1"), report(number))
    assert recording.dropped == 15
    assert len(said) == 1
    assert "too slow" in said[0]


def test_what_waits_for_a_slow_disk_is_bounded_by_its_bytes_too(tmp_path: Path) -> None:
    said: list[str] = []
    recording = Recording(McapFiles(tmp_path, {}, SizeLimits()), ManualClock(), said.append)
    for _ in range(3):
        recording.note(KEYS.position("U1"), bytes(QUEUE_BYTES // 2))
    assert recording.dropped == 1
    assert len(said) == 1


async def test_ever_new_keys_neither_end_the_recording_nor_grow_what_is_counted(tmp_path: Path) -> None:
    bus, clock, said = Everything(), ManualClock(), []
    async with open_recording(tmp_path, bus, KEYS, clock, said.append) as recording:
        for number in range(MOST_KEYS + 5):
            bus.hear(KEYS.position(f"X{number}"), position(float(number)))
        recording.note_monitor("U1", MonitorNote(0, 1.0, begun=True))
    counted = traffic(tmp_path)["keys"]
    assert len(counted) == MOST_KEYS + 1
    assert counted["further"]["messages"] == 5
    topics = [topic for topic, *_ in read(tmp_path / "flight.mcap")]
    assert len(topics) == MOST_KEYS + 6
    assert topics[-1] == "monitor/U1"
    assert not said
