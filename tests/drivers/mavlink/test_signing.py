"""Signing against pymavlink's own, both ways: what is signed is believed once, and nothing else is."""

import hashlib
import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Codec, FrameSplitter
from drivers.mavlink.signing import LinkSigner, RefusedCounters, Signing, open_signing
from drivers.mavlink.signing_clock import UNITS_PER_S, SigningClock
from drivers.mavlink.signing_key import SigningKey
from tests.fakes import FAKE_UNIX_NS, ManualClock

SECRET = bytes(range(1, 33))
OTHER_SECRET = bytes(range(2, 34))
NOW = (FAKE_UNIX_NS - 1_420_070_400 * 10**9) // 10_000
"""A ManualClock's start as a signing timestamp."""
LINK = "udpin:127.0.0.1:14550"
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3)


def signer(secret=SECRET, link_id=7):
    return LinkSigner(SigningKey(secret), SigningClock(ManualClock()), link_id, LINK)


def signed_codec(**identity):
    return Codec(signing=signer(), **identity)


class Peer:
    """pymavlink as the other side of a signed link."""

    def __init__(self, secret=SECRET, *, system_id=1, component_id=1, link_id=3, timestamp=NOW):
        self.mavlink = mavlink.MAVLink(None, system_id, component_id)
        self.mavlink.signing.secret_key = secret
        self.mavlink.signing.link_id = link_id
        self.mavlink.signing.timestamp = timestamp
        self.mavlink.signing.sign_outgoing = True

    def frame(self, message=HEARTBEAT):
        return bytearray(message.pack(self.mavlink))

    def hears(self, frame):
        try:
            return self.mavlink.decode(bytearray(frame)).get_signed()
        except mavlink.MAVError:
            return False


def messages():
    return [
        HEARTBEAT,
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0x05C7, *(0.0,) * 3, 1.5, -2.0, 0.25, *(0.0,) * 5
        ),
        mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_param_set_message(1, 1, b"GUID_TIMEOUT", 1.0, 9),
        mavlink.MAVLink_statustext_message(6, b"x" * 50),
    ]


@pytest.mark.parametrize("message", messages(), ids=lambda message: message.get_type())
def test_pymavlink_believes_what_is_signed_and_reads_it_whole(message):
    codec, peer = signed_codec(system_id=255, component_id=190), Peer()
    for _ in range(3):
        frame = codec.encode(message)
        heard = peer.mavlink.decode(bytearray(frame))
        assert heard.get_signed()
        assert heard.get_link_id() == 7
        assert heard.to_dict() == message.to_dict()


@pytest.mark.parametrize("message", messages(), ids=lambda message: message.get_type())
def test_a_frame_differs_from_pymavlinks_in_no_byte(message):
    codec = Codec(1, 1, signing=signer(link_id=3))
    assert codec.encode(message) == Peer(timestamp=NOW).frame(message)


@pytest.mark.parametrize("message", messages(), ids=lambda message: message.get_type())
def test_what_pymavlink_signs_is_accepted_and_read(message):
    codec, peer = signed_codec(), Peer()
    frames = [peer.frame(message) for _ in range(3)]
    assert FrameSplitter().datagram(b"".join(frames)) == frames
    assert all(codec.accepts(frame) for frame in frames)
    assert codec.decode(frames[0]).to_dict() == message.to_dict()
    assert codec.signing.refused == RefusedCounters()


def test_without_a_key_everything_is_accepted_and_nothing_signed():
    codec = Codec()
    assert codec.accepts(bytearray(codec.encode(HEARTBEAT)))
    assert codec.accepts(Peer().frame())
    assert not codec.encode(HEARTBEAT)[2]


@given(st.data())
def test_a_frame_changed_anywhere_is_refused(data):
    codec, frame = signed_codec(), Peer().frame()
    position = data.draw(st.integers(0, len(frame) - 1))
    frame[position] ^= data.draw(st.integers(1, 255))
    assert not codec.accepts(frame)
    refused = codec.signing.refused
    assert (refused.wrong_signature, refused.unsigned) == ((0, 1) if not frame[2] & 1 else (1, 0))


def test_another_key_is_refused_by_both_sides():
    codec, stranger = signed_codec(), Peer(OTHER_SECRET)
    assert not codec.accepts(stranger.frame())
    assert codec.signing.refused == RefusedCounters(wrong_signature=1)
    assert not stranger.hears(codec.encode(HEARTBEAT))


def test_unsigned_frames_are_refused_and_counted():
    codec, plain = signed_codec(), Codec(1, 1)
    assert not any(codec.accepts(bytearray(plain.encode(message))) for message in messages())
    assert codec.signing.refused == RefusedCounters(unsigned=len(messages()))


def test_a_frame_counts_once():
    codec, peer = signed_codec(), Peer()
    first, second = peer.frame(), peer.frame()
    assert codec.accepts(second)
    assert not codec.accepts(second)
    assert not codec.accepts(first), "an older one than was heard"
    assert codec.signing.refused == RefusedCounters(replayed=2)


def test_each_sender_on_each_of_its_links_is_a_stream_of_its_own():
    codec = signed_codec()
    streams = [Peer(), Peer(system_id=2), Peer(component_id=154), Peer(link_id=4)]
    frames = [peer.frame() for peer in streams]
    assert all(codec.accepts(frame) for frame in frames)
    assert not any(codec.accepts(frame) for frame in frames)


def test_a_forged_timestamp_does_not_silence_the_stream_it_names():
    """The signature is told before the timestamp is remembered."""
    codec, peer = signed_codec(), Peer()
    assert codec.accepts(peer.frame())
    assert not codec.accepts(Peer(OTHER_SECRET, timestamp=2**48 - 1).frame())
    assert codec.accepts(peer.frame())


@pytest.mark.parametrize(("behind", "accepted"), [(0, True), (60 * UNITS_PER_S, True), (60 * UNITS_PER_S + 1, False)])
def test_a_stream_may_begin_no_more_than_a_minute_behind(behind, accepted):
    codec = signed_codec()
    assert codec.accepts(Peer(timestamp=NOW - behind).frame()) == accepted
    assert codec.signing.refused.replayed == (not accepted)


def test_a_stream_that_has_begun_may_fall_behind():
    """As when another vehicle's clock is ahead: only going back within a stream is a replay."""
    codec, slow = signed_codec(), Peer(timestamp=NOW)
    assert codec.accepts(slow.frame())
    assert codec.accepts(Peer(system_id=2, timestamp=NOW + 3600 * UNITS_PER_S).frame())
    assert codec.accepts(slow.frame())


def test_a_timestamp_ahead_of_ours_is_caught_up_with():
    codec, peer = signed_codec(), Peer(timestamp=NOW + 3600 * UNITS_PER_S)
    assert codec.accepts(peer.frame())
    assert peer.hears(codec.encode(HEARTBEAT)), "we are no more than a minute behind the vehicle"
    assert int.from_bytes(codec.encode(HEARTBEAT)[-12:-6], "little") > NOW + 3600 * UNITS_PER_S


def test_a_refused_frame_moves_no_clock():
    codec = signed_codec()
    assert not codec.accepts(Peer(OTHER_SECRET, timestamp=NOW + 3600 * UNITS_PER_S).frame())
    assert int.from_bytes(codec.encode(HEARTBEAT)[-12:-6], "little") == NOW


@pytest.mark.parametrize(
    ("message", "system_id", "component_id", "accepted"),
    [
        pytest.param(mavlink.MAVLink_radio_status_message(200, 190, 50, 40, 40, 0, 0), 51, 68, True, id="SiK radio"),
        pytest.param(mavlink.MAVLink_radio_message(200, 190, 50, 40, 40, 0, 0), 51, 68, True, id="older SiK radio"),
        pytest.param(mavlink.MAVLink_radio_status_message(1, 1, 1, 1, 1, 0, 0), 1, 1, False, id="as a vehicle"),
        pytest.param(HEARTBEAT, 51, 68, False, id="a radio's heartbeat"),
    ],
)
def test_only_a_radios_own_reports_may_come_unsigned(message, system_id, component_id, accepted):
    codec, sender = signed_codec(), Codec(system_id, component_id)
    assert codec.accepts(bytearray(sender.encode(message))) == accepted


def test_an_unknown_message_is_judged_alike(frame_of):
    codec = signed_codec()
    assert not codec.accepts(frame_of(0xABCDE, b"??"))
    frame = frame_of(0xABCDE, b"??", incompat_flags=1)
    assert not codec.accepts(frame), "it has no room for a signature"
    stamped = bytes(frame) + bytes([3]) + NOW.to_bytes(6, "little")
    assert codec.accepts(bytearray(stamped + hashlib.sha256(SECRET + stamped).digest()[:6]))


def test_each_reason_is_said_once_with_the_way_out(caplog):
    codec, peer = signed_codec(), Peer()
    heard = peer.frame()
    codec.accepts(heard)
    caplog.clear()
    for _ in range(3):
        codec.accepts(bytearray(Codec(1, 1).encode(HEARTBEAT)))
        codec.accepts(Peer(OTHER_SECRET, system_id=2).frame())
        codec.accepts(heard)
    assert [record.levelno for record in caplog.records] == [logging.WARNING] * 3
    unsigned, wrong, replayed = (record.message for record in caplog.records)
    assert unsigned.startswith(f"{LINK}: a frame of system 1, component 1 was dropped: unsigned.")
    assert "SETUP_SIGNING" in unsigned
    assert "system 2" in wrong
    assert "the same key" in wrong
    assert "repeats old frames" in replayed


def test_a_vehicle_that_is_behind_is_told_from_a_replay(caplog):
    signed_codec().accepts(Peer(timestamp=NOW - 90 * UNITS_PER_S).frame())
    assert "90 s behind this station: check the time here, and that the vehicle has GPS time" in caplog.text


def test_no_log_line_shows_the_key(caplog):
    test_each_reason_is_said_once_with_the_way_out(caplog)
    assert SECRET.hex() not in caplog.text
    assert repr(SECRET) not in caplog.text
    assert SECRET.hex() not in repr(signed_codec())


def test_no_two_frames_of_a_process_carry_one_timestamp(tmp_path):
    signing = Signing(SigningClock(ManualClock()))
    codecs = [Codec(signing=signing.link(SigningKey(SECRET), f"udpout:10.0.0.{n}:14550")) for n in range(20)]
    stamps = [codec.encode(HEARTBEAT)[-12:-6] for _ in range(50) for codec in codecs]
    assert len(set(stamps)) == 1000


def test_links_get_ids_of_their_own_that_stay_from_run_to_run():
    key, addresses = SigningKey(SECRET), [f"udpin:0.0.0.0:{14550 + n}" for n in range(256)]
    first, again = (Signing(SigningClock(ManualClock())) for _ in range(2))
    ids = [first.link(key, address).link_id for address in addresses]
    assert sorted(ids) == list(range(256))
    assert again.link(key, addresses[0]).link_id == ids[0]
    assert first.link(key, "udpin:0.0.0.0:1").link_id in range(256), "more links than ids share them"


async def test_links_opened_together_share_one_clock(tmp_path):
    async with open_signing(ManualClock(), tmp_path / "state") as signing:
        one, other = (Codec(signing=signing.link(SigningKey(SECRET), address)) for address in ("a", "b"))
        stamps = [int.from_bytes(codec.encode(HEARTBEAT)[-12:-6], "little") for codec in (one, other, one)]
        assert stamps == [NOW, NOW + 1, NOW + 2]
