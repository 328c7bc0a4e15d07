"""Where the service has a token, only who holds it commands; each word counts once, and only while it is new."""

from __future__ import annotations

import msgspec
import pytest

from drivers.bus.messages import ControlReply, ControlRequest, decode, encode
from drivers.bus.run_messages import ProvenRequest, decode_run
from gcs.monitor.access import Token
from gcs.monitor.proven import VALID_S, ControlGuard, plainly, proving
from tests.fakes import ManualClock

SECRET = "correct horse battery"
HOLD, SKIP = ControlRequest("hold"), ControlRequest("skip", "U3")


class Desk:
    """A service with a token, and what it was told to do."""

    def __init__(self, secret: str | None = SECRET) -> None:
        self.done: list[ControlRequest] = []
        self.clock = ManualClock()
        token = None if secret is None else Token(secret)
        self.guard = ControlGuard("paper-8", self._answer, token, self.clock)

    def _answer(self, payload: bytes) -> bytes:
        self.done.append(decode(payload, ControlRequest))
        return encode(ControlReply(ok=True, message="done"))

    def take(self, payload: bytes) -> ControlReply:
        return decode(self.guard.take(payload), ControlReply)


@pytest.mark.parametrize("request_", [HOLD, SKIP])
def test_a_proven_word_is_carried_out(request_: ControlRequest) -> None:
    desk = Desk()
    assert desk.take(proving(Token(SECRET), desk.clock)("paper-8", request_)).ok
    assert desk.done == [request_]


def test_the_token_itself_is_never_said() -> None:
    payload = proving(Token(SECRET), ManualClock())("paper-8", HOLD)
    assert SECRET.encode() not in payload
    assert "not shown" in repr(Token(SECRET))


def test_a_word_without_a_proof_is_refused_with_the_way_out() -> None:
    desk = Desk()
    reply = desk.take(plainly("paper-8", HOLD))
    assert not reply.ok
    assert "--command-token-file" in reply.message
    assert not desk.take(b"garbage").ok
    assert desk.done == []


def test_another_token_another_swarm_another_word_prove_nothing() -> None:
    desk = Desk()
    proven = decode_run(proving(Token(SECRET), desk.clock)("paper-8", SKIP), ProvenRequest)
    tampered = [
        proving(Token("another, just as long"), desk.clock)("paper-8", SKIP),
        proving(Token(SECRET), desk.clock)("paper-20", SKIP),
        encode(msgspec.structs.replace(proven, verb="release")),
        encode(msgspec.structs.replace(proven, vehicle="U4")),
        encode(msgspec.structs.replace(proven, said_ns=proven.said_ns + 1)),
    ]
    replies = [desk.take(payload) for payload in tampered]
    assert [reply.message for reply in replies] == ["that is not the token of this run"] * len(tampered)
    assert desk.done == []


def test_a_word_counts_once() -> None:
    desk = Desk()
    payload = proving(Token(SECRET), desk.clock)("paper-8", HOLD)
    assert desk.take(payload).ok
    assert "said before" in desk.take(payload).message
    desk.clock.jump(1.0)
    assert desk.take(proving(Token(SECRET), desk.clock)("paper-8", HOLD)).ok


@pytest.mark.parametrize("late_s", [VALID_S + 1.0, -VALID_S - 1.0])
def test_an_old_word_and_one_from_the_future_are_refused(late_s: float) -> None:
    desk = Desk()
    desk.clock.jump(100.0)
    payload = proving(Token(SECRET), desk.clock)("paper-8", HOLD)
    desk.clock.jump(late_s)
    assert "set the clocks" in desk.take(payload).message
    assert desk.done == []


def test_a_service_without_a_token_carries_out_any_word() -> None:
    desk = Desk(None)
    assert desk.take(plainly("paper-8", HOLD)).ok
    assert desk.take(proving(Token(SECRET), desk.clock)("paper-8", SKIP)).ok
    assert desk.done == [HOLD, SKIP]
    assert proving(None) is plainly
