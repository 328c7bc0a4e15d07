"""Whatever bytes arrive: whole MAVLink 2 frames come out, and damage stays with the frame it hit."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Codec, FrameHeader, FrameSplitter

HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3)
UNKNOWN_ID = 0xABCDE


def frames(count, codec=None):
    codec = codec or Codec(1, 1)
    return [bytearray(codec.encode(HEARTBEAT)) for _ in range(count)]


def signed(frame):
    """Return a frame as a signing station sends it."""
    packer = mavlink.MAVLink(None, 1, 1)
    packer.signing.secret_key = bytes(32)
    packer.signing.link_id = 1
    packer.signing.timestamp = 1
    packer.signing.sign_outgoing = True
    return bytearray(mavlink.MAVLink(None, 1, 1).decode(bytearray(frame)).pack(packer))


def test_a_message_comes_back_as_it_was_encoded():
    message = Codec().decode(bytearray(Codec(7, 1).encode(HEARTBEAT)))
    assert message.get_type() == "HEARTBEAT"
    assert (message.get_srcSystem(), message.get_srcComponent()) == (7, 1)
    assert (message.type, message.autopilot, message.custom_mode) == (2, 3, 4)


def test_frames_are_mavlink_2_numbered_in_sequence_and_wrap():
    sent = frames(258)
    assert {frame[0] for frame in sent} == {0xFD}
    assert [frame[4] for frame in sent] == [*range(256), 0, 1]


def test_a_header_is_read_from_its_ten_bytes(frame_of):
    frame = bytearray(Codec(9, 158).encode(mavlink.MAVLink_ekf_status_report_message(1, 0, 0, 0, 0, 0)))
    assert FrameHeader.of(frame) == FrameHeader(0, 9, 158, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT)
    assert FrameHeader.of(frame_of(UNKNOWN_ID, b"x")).message_id == UNKNOWN_ID


def test_glued_frames_are_cut_apart_and_bytes_between_them_counted():
    one, two, three = frames(3)
    splitter = FrameSplitter()
    assert splitter.datagram(b"\x00\x01" + one + two + b"junk" + three) == [one, two, three]
    assert splitter.skipped_bytes == 6


@pytest.mark.parametrize("length", range(1, 21))
def test_a_truncated_datagram_costs_only_the_frame_it_cut(length):
    whole, cut, following = frames(3)
    splitter = FrameSplitter()
    assert splitter.datagram(bytes(whole + cut[:length])) == [whole]
    assert splitter.skipped_bytes == length
    assert splitter.datagram(bytes(following)) == [following]


def test_signed_frames_are_cut_at_their_whole_length_and_read():
    plain, other = frames(2)
    frame = signed(plain)
    assert len(frame) == len(plain) + 13
    assert FrameSplitter().datagram(bytes(frame + other)) == [frame, other]
    assert Codec().decode(frame).get_type() == "HEARTBEAT"


def test_mavlink_1_is_refused():
    old = HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True)
    splitter, (following,) = FrameSplitter(), frames(1)
    assert splitter.datagram(old + bytes(following)) == [following]
    assert splitter.stream(old + bytes(following)) == [following]
    assert splitter.skipped_bytes == 2 * len(old)


def test_an_unknown_message_id_yields_nothing(frame_of):
    assert Codec().decode(frame_of(UNKNOWN_ID, b"who am I")) is None


@pytest.mark.parametrize("position", range(21))
@pytest.mark.parametrize("how", ["datagram", "stream"])
def test_damage_anywhere_costs_one_frame_and_spoils_no_neighbour(position, how):
    """Magic, length, flags, sequence, ids, payload or checksum: the frames glued before and behind survive."""
    glued = frames(40)
    glued[1][position] ^= 0x40
    splitter = FrameSplitter()
    cut = getattr(splitter, how)(b"".join(glued))
    assert [frame for frame in cut if frame != glued[1]] == [glued[0], *glued[2:]]
    assert all(Codec().decode(frame) is None for frame in cut if frame == glued[1])  # now of an unknown message id


def test_unknown_incompatibility_flags_are_refused():
    flagged, following = frames(2)
    flagged[2] |= 0x02
    assert FrameSplitter().datagram(bytes(flagged + following)) == [following]
    codec = Codec()
    assert codec.decode(flagged) is None
    assert codec.malformed == 1


def noise_like_a_header(frame_of, length):
    """What looks like a frame with an unknown message id that is longer than the noise itself."""
    return bytes(frame_of(UNKNOWN_ID, bytes(length))[:10])


@pytest.mark.parametrize("length", [20, 100, 255])
def test_noise_that_looks_like_a_header_swallows_no_frame_of_its_datagram(frame_of, length):
    sent = frames(3)
    splitter = FrameSplitter()
    assert splitter.datagram(noise_like_a_header(frame_of, length) + b"".join(sent)) == sent
    assert splitter.skipped_bytes == 10


@pytest.mark.parametrize("length", [20, 100, 255])
def test_noise_that_looks_like_a_header_swallows_no_frame_of_a_stream(frame_of, length):
    sent = frames(20)
    splitter, heard = FrameSplitter(), []
    for piece in (noise_like_a_header(frame_of, length), *sent):
        heard += splitter.stream(bytes(piece))
    assert heard == sent


def test_a_frame_with_an_unknown_id_is_cut_where_the_next_begins_or_the_datagram_ends(frame_of):
    unknown, (known,) = frame_of(UNKNOWN_ID, b"who am I"), frames(1)
    assert FrameSplitter().datagram(bytes(unknown + known + unknown)) == [unknown, known, unknown]
    splitter = FrameSplitter()
    assert splitter.stream(bytes(unknown)) == []
    assert splitter.stream(bytes(known)) == [unknown, known]


def test_a_stream_does_not_wait_for_what_no_frame_can_be():
    """Behind unknown flags a length means nothing."""
    (frame,) = frames(1)
    assert FrameSplitter().stream(b"\xfd\xff\x80\0\0\0\0\0\0\0" + bytes(frame)) == [frame]


def test_a_stream_keeps_no_more_than_one_frame(frame_of):
    splitter = FrameSplitter()
    for _ in range(1000):
        splitter.stream(bytes(frame_of(UNKNOWN_ID, bytes(255))[:-1]))
        assert len(splitter._rest) <= 280


@given(st.integers(0, 20), st.integers(1, 255))
def test_any_damage_in_one_datagram_leaves_the_datagrams_around_it_whole(position, flipped_bits):
    sent = frames(3)
    sent[1][position] ^= flipped_bits
    splitter, codec = FrameSplitter(), Codec()
    heard = [[codec.decode(frame) for frame in splitter.datagram(bytes(datagram))] for datagram in sent]
    assert [message.get_type() for message in heard[0] + heard[2]] == ["HEARTBEAT", "HEARTBEAT"]


@given(st.lists(st.integers(1, 40), max_size=30))
def test_a_stream_is_cut_alike_however_it_is_chopped(piece_lengths):
    sent = frames(12)
    rest, splitter, heard = b"\x55".join(bytes(frame) for frame in sent), FrameSplitter(), []
    for length in [*piece_lengths, 10_000]:
        heard += splitter.stream(rest[:length])
        rest = rest[length:]
    assert heard == sent
    assert splitter.skipped_bytes == 11


def test_an_unfinished_frame_waits_for_the_rest_of_the_stream():
    first, second = frames(2)
    splitter = FrameSplitter()
    assert splitter.stream(bytes(first[:-1])) == []
    assert splitter.stream(bytes(first[-1:] + second)) == [first, second]
    assert splitter.skipped_bytes == 0


@settings(max_examples=300)
@given(st.lists(st.binary(max_size=300) | st.binary(max_size=300).map(lambda data: b"\xfd" + data), max_size=5))
def test_no_bytes_raise(pieces):
    datagrams, stream, codec = FrameSplitter(), FrameSplitter(), Codec()
    for piece in pieces:
        for frame in datagrams.datagram(piece) + stream.stream(piece):
            codec.decode(frame)


@settings(max_examples=500, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from([*mavlink.mavlink_map, UNKNOWN_ID]), st.binary(max_size=255), st.integers(0, 255))
def test_no_payload_under_a_right_checksum_raises(frame_of, message_id, payload, incompat_flags):
    message = Codec().decode(frame_of(message_id, payload, incompat_flags=incompat_flags))
    if message is not None:
        assert message.get_msgId() == message_id
