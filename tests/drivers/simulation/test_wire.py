"""Whatever bytes arrive, the autopilot lives on."""

import struct
from itertools import accumulate

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation.autopilot import COMPONENT_ID, UNDERSTOOD
from drivers.simulation.commands import COMMANDS
from drivers.simulation.wire import Codec

HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def packed(message):
    return message.pack(mavlink.MAVLink(None, 255, 190))


def frame_of(message_id, payload):
    """Return a frame with a right length and checksum around any payload."""
    head = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, 0, 255, 190, message_id & 0xFFFF, message_id >> 16)
    crc = mavlink.x25crc(head[1:] + payload + bytes([mavlink.mavlink_map[message_id].crc_extra]))
    return head + payload + struct.pack("<H", crc.crc)


def test_several_frames_in_one_datagram_are_all_read():
    codec = Codec(UNDERSTOOD, COMPONENT_ID)
    assert len(list(codec.decode(packed(HEARTBEAT) * 3))) == 3
    assert codec.malformed == 0


def test_a_wrong_checksum_costs_one_frame_only():
    codec = Codec(UNDERSTOOD, COMPONENT_ID)
    broken = bytearray(packed(HEARTBEAT))
    broken[-1] ^= 0xFF
    assert len(list(codec.decode(bytes(broken) + packed(HEARTBEAT)))) == 1
    assert codec.malformed == 1


def test_a_truncated_datagram_is_counted_and_does_not_spoil_the_next():
    codec = Codec(UNDERSTOOD, COMPONENT_ID)
    assert list(codec.decode(packed(HEARTBEAT)[:-1])) == []
    assert codec.malformed == 1
    assert len(list(codec.decode(packed(HEARTBEAT)))) == 1


def test_mavlink_1_is_not_understood():
    codec = Codec(UNDERSTOOD, COMPONENT_ID)
    old = HEARTBEAT.pack(mavlink.MAVLink(None, 255, 190), force_mavlink1=True)
    assert list(codec.decode(old)) == []
    assert codec.malformed == 1


def test_frames_are_numbered_in_sequence():
    codec = Codec(UNDERSTOOD, COMPONENT_ID)
    frames = [codec.encode(HEARTBEAT, 3) for _ in range(257)]
    assert [frame[4] for frame in frames] == [*range(256), 0]
    assert {frame[5:7] for frame in frames} == {bytes([3, 1])}


@given(st.binary(max_size=300))
def test_no_datagram_raises(datagram):
    list(Codec(UNDERSTOOD, COMPONENT_ID).decode(datagram))
    list(Codec(UNDERSTOOD, COMPONENT_ID).decode(b"\xfd" + datagram))


def aimed(message_id, payload):
    """Return a payload with its target ids, if it has any, made zero: for everyone."""
    kind = mavlink.mavlink_map[message_id]
    sizes = zip(kind.native_format.decode()[1:], kind.array_lengths, strict=True)
    starts = list(accumulate((struct.calcsize(code) * max(1, count) for code, count in sizes), initial=0))
    full = bytearray(payload.ljust(starts[-1], b"\0")[:255])
    for name in {"target_system", "target_component"} & set(kind.fieldnames):
        full[starts[kind.ordered_fieldnames.index(name)]] = 0
    return bytes(full)


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(st.sampled_from(sorted(UNDERSTOOD)), st.binary(min_size=1, max_size=60)), min_size=1, max_size=4
    ),
    st.booleans(),
)
def test_no_well_formed_message_raises_whatever_it_holds(make_bench, messages, flying):
    bench = make_bench()
    if flying:
        bench.take_off(settle_s=8)
    for message_id, payload in messages:
        bench.gcs.send_frame(frame_of(message_id, aimed(message_id, payload)))
    bench.run(3)
    bench.gcs.heard.clear()


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(sorted(COMMANDS)),
    st.lists(st.floats(width=32) | st.sampled_from([0.0, 1.0, 4.0, 33.0, 21196.0]), min_size=7, max_size=7),
    st.booleans(),
)
def test_no_command_raises_whatever_its_parameters(make_bench, number, parameters, flying):
    bench = make_bench()
    if flying:
        bench.take_off(settle_s=8)
    assert bench.gcs.command(number, *parameters) is not None
    bench.run(3)
