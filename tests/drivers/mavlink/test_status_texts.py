"""Texts of several pieces come out whole, in order, whatever is lost on the way."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.status_texts import PIECE_LENGTH, StatusTexts

LONG = "Preflight Fail: the magnetometer 1 is inconsistent with the heading that GNSS gives, check your compass"


def pieces(text, number):
    for sequence, start in enumerate(range(0, len(text), PIECE_LENGTH)):
        yield piece(text[start : start + PIECE_LENGTH], number, sequence)


def piece(text, number=0, sequence=0):
    packed = mavlink.MAVLink_statustext_message(4, text.encode(), number, sequence).pack(mavlink.MAVLink(None, 1, 1))
    return mavlink.MAVLink(None).decode(bytearray(packed))


def texts_of(*messages):
    texts = StatusTexts()
    return [text for message in messages for text in texts.take(message)]


def test_a_short_text_comes_out_at_once():
    assert texts_of(piece("PreArm: GPS 1: Bad fix")) == ["PreArm: GPS 1: Bad fix"]


def test_a_short_text_that_fills_its_message_is_whole():
    assert texts_of(piece("x" * PIECE_LENGTH)) == ["x" * PIECE_LENGTH]


def test_a_long_text_comes_out_with_its_last_piece():
    assert len(list(pieces(LONG, 7))) == 3
    assert texts_of(*pieces(LONG, 7)) == [LONG]


def test_a_text_whose_end_is_lost_comes_out_before_the_next():
    first, second, _ = pieces(LONG, 7)
    assert texts_of(first, second, piece("and now this")) == [LONG[:100], "and now this"]
    assert texts_of(first, *pieces(LONG, 8)) == [LONG[:50], LONG]


def test_a_text_without_end_comes_out_in_parts():
    texts = texts_of(*(piece("x" * PIECE_LENGTH, 7, number % 256) for number in range(25)))
    assert [len(text) for text in texts] == [500, 500]


def test_what_would_steer_a_terminal_is_replaced():
    assert texts_of(piece("a\x1b[2Jb\nc"), *pieces("\x07" * 60, 7)) == ["a?[2Jb?c", "?" * 60]
