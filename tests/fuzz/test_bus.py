"""What comes off the bus: a message is right and taken, or wrong, dropped and counted; nothing else comes of it."""

from __future__ import annotations

import tracemalloc
from dataclasses import asdict
from random import Random
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus import messages, run_messages
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import (
    Bearing,
    BearingReport,
    ClockPong,
    ControlReply,
    ControlRequest,
    MalformedMessageError,
    decode,
    encode,
)
from drivers.bus.run_messages import ProvenRequest, decode_run
from gcs.bearings import BearingFeed
from gcs.clock_offsets import ClockOffsets
from gcs.monitor.access import Token
from gcs.monitor.proven import ControlGuard
from planner.frames import FormationFrame
from tests.fakes import FAKE_UNIX_NS, FakeBus, ManualClock
from tests.fuzz.hostile import as_json, damaged, examples, mutated, plain, values

KEYS = SwarmKeys("test")
REPORT = plain(BearingReport(FAKE_UNIX_NS, 1, "true_north", [Bearing("L0", 1.0, 0.01)], 1, "clock", 0.1))
DEEP = (b"[" * 10_000, b'{"x":' * 10_000, b'{"x":' + b"[" * 10_000)
KINDS = [(kind, decode) for kind in messages.KINDS] + [(kind, decode_run) for kind in run_messages.KINDS]


def hostile(document: Any) -> st.SearchStrategy[bytes]:
    return (
        mutated(document).map(as_json)
        | damaged(as_json(document))
        | values.map(as_json)
        | st.binary(max_size=100)
        | st.sampled_from(DEEP)
    )


@pytest.mark.parametrize(("kind", "read"), KINDS)
@examples(15)
@given(data=st.data())
def test_a_payload_is_a_message_or_malformed(kind: type[msgspec.Struct], read: Any, data: st.DataObject) -> None:
    document = {field.encode_name: data.draw(values) for field in msgspec.structs.fields(kind)}
    payload = data.draw(hostile(document))
    try:
        message = read(payload, kind)
    except MalformedMessageError as error:
        assert str(error)  # noqa: PT017 - most are malformed, and none has to be
        return
    assert read(encode(message), kind) == message


@examples(100)
@given(payload=hostile(REPORT))
def test_a_report_is_taken_or_counted(payload: bytes) -> None:
    clock = ManualClock()
    feed = BearingFeed(["U1"], FormationFrame(0.0), clock, max_age_s=0.5)
    feed.take(KEYS.bearings("U1"), payload)
    counted = asdict(feed.counters)
    assert counted.pop("received") == 1
    assert sum(counted.values()) == ("U1" not in feed.latest)


@examples(50)
@given(payload=hostile(plain(ClockPong(FAKE_UNIX_NS, FAKE_UNIX_NS, FAKE_UNIX_NS, "clock"))), report=hostile(REPORT))
def test_a_sensor_s_clock_says_what_it_likes(payload: bytes, report: bytes) -> None:
    clock, said = ManualClock(), []
    clocks = ClockOffsets(["U1"], clock, said.append)
    feed = BearingFeed(["U1"], FormationFrame(0.0), clock, max_age_s=0.5, clocks=clocks)
    clocks.ask_on(FakeBus(), KEYS)
    clocks.clocks["U1"].ask(clock.unix_ns(), clock.now_s())
    clock.jump(0.01)
    clocks.take(KEYS.clock_pong("U1"), payload)
    feed.take(KEYS.bearings("U1"), report)
    assert feed.counters.received == 1
    assert all(said)


@examples(50)
@given(
    payload=hostile({"verb": "hold", "vehicle": None})
    | hostile(plain(ProvenRequest("hold", FAKE_UNIX_NS, "0" * 64)))
    | st.builds(ControlRequest, st.sampled_from(["hold", "abort", "skip"]), st.text(min_size=1, max_size=8)).map(encode)
)
def test_no_word_without_the_token_is_carried_out_and_each_is_answered(payload: bytes) -> None:
    done: list[bytes] = []

    def carry_out(request: bytes) -> bytes:
        done.append(request)
        return encode(ControlReply(ok=True, message="done"))

    guard = ControlGuard("test", carry_out, Token("correct horse battery staple"), ManualClock())
    reply = decode(guard.take(payload), ControlReply)
    assert not reply.ok
    assert reply.message
    assert not done


def test_a_flood_of_all_this_leaves_nothing_behind() -> None:
    random, clock = Random(8), ManualClock()
    feed = BearingFeed(["U1"], FormationFrame(0.0), clock, max_age_s=0.5)
    feed.take(KEYS.bearings("U1"), as_json(REPORT))
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for number in range(10_000):
            sender = random.choice(("U1", "U1", f"U{number}", "x" * 60))
            report = REPORT | {"sequence": number, "captured_ns": FAKE_UNIX_NS + random.randrange(-(10**9), 10**9)}
            feed.take(KEYS.bearings(sender), random.choice((msgspec.json.encode(report), b"{", random.randbytes(50))))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 200_000
    assert feed.counters.received == 10_001
