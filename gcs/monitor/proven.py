"""Words to the relay from those who hold the token for commanding: proven by it, without ever saying it.

Where the service has a token, whoever reaches the bus may watch, but only a proven word is carried out: each once, and
only while it is new.
"""

from __future__ import annotations

import hmac
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.messages import ControlReply, ControlRequest, MalformedMessageError, encode
from drivers.bus.run_messages import ProvenRequest, decode_run
from drivers.bus.session import Answer
from drivers.clock import Clock, SystemClock
from gcs.monitor.access import Token

VALID_S: Final = 30.0
"""How far the clocks of two machines may be apart, and for how long a word is good."""
_REMEMBERED: Final = 10_000

Words = Callable[[str, ControlRequest], bytes]
"""Returns a word to a swarm as it goes over the bus."""


def plainly(swarm: str, request: ControlRequest) -> bytes:
    """Return a word as it is, without a proof."""
    del swarm
    return encode(request)


def proving(token: Token | None, clock: Clock | None = None) -> Words:
    """Return what proves words by a token; without one they go plainly."""
    if token is None:
        return plainly
    time = clock or SystemClock()

    def prove(swarm: str, request: ControlRequest) -> bytes:
        said_ns = time.unix_ns()
        proof = token.sign(_text(swarm, request.verb, request.vehicle, said_ns))
        return encode(ProvenRequest(request.verb, said_ns, proof, request.vehicle))

    return prove


@dataclass
class ControlGuard:
    """Lets through to `answer` what may be carried out; with a token that is only what it proves."""

    swarm: str
    answer: Answer
    token: Token | None
    clock: Clock = field(default_factory=SystemClock)
    """The machine's own: it is what others go by."""
    _carried_out: deque[str] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))

    def take(self, payload: bytes) -> bytes:
        """Return the ControlReply to a ControlRequest or a ProvenRequest, as they are on the bus."""
        try:
            request = decode_run(payload, ProvenRequest)
        except MalformedMessageError:
            if self.token is None:
                return self.answer(payload)
            return _refused("this run takes words only from those who hold its token: give --command-token-file")
        if self.token is not None and (objection := self._objection(request, self.token)) is not None:
            return _refused(objection)
        self._carried_out.append(request.proof)
        return self.answer(encode(ControlRequest(request.verb, request.vehicle)))

    def _objection(self, request: ProvenRequest, token: Token) -> str | None:
        expected = token.sign(_text(self.swarm, request.verb, request.vehicle, request.said_ns))
        if not hmac.compare_digest(expected.encode(), request.proof.encode()):
            return "that is not the token of this run"
        age_s = (self.clock.unix_ns() - request.said_ns) * 1e-9
        if abs(age_s) > VALID_S:
            return f"that was said {age_s:.0f} s ago by the clock of this machine: set the clocks, and say it again"
        return "that has been said before: say it again" if request.proof in self._carried_out else None


def _text(swarm: str, verb: str, vehicle: str | None, said_ns: int) -> str:
    return "\n".join((swarm, verb, vehicle or "", str(said_ns)))


def _refused(message: str) -> bytes:
    return encode(ControlReply(ok=False, message=message))
