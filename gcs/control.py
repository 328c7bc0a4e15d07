"""The operator's word: what is asked of the relay, what is done about it, and the answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.bus.messages import ControlReply, ControlRequest, MalformedMessageError, decode, encode
from gcs.relay.executor import RelayExecutor
from gcs.relay.states import ENDED

STOPPED = "stopped by the operator"
TAKEOVER = "takeover"
"""The operator's consent to giving on the vehicles of a lost link node, which it names."""


def carry_out(request: ControlRequest, relay: RelayExecutor) -> ControlReply:
    """Do what the operator asks of a relay; the answer says what was done, or why not and the way out."""
    if request.verb == TAKEOVER:
        return _refused("this relay has no link nodes")
    if (request.vehicle is not None) is not (request.verb in _OF_ONE):
        return _refused(f"{request.verb} names " + ("one vehicle" if request.verb in _OF_ONE else "no vehicle"))
    if relay.ended:
        return _refused("the relay has ended")
    relay.look()  # a take-over of this instant counts
    if request.vehicle is not None:
        return _OF_ONE[request.verb](relay, request.vehicle)
    return _OF_ALL[request.verb](relay)


def _hold(relay: RelayExecutor) -> ControlReply:
    already = relay.held
    held = relay.hold("held by the operator", wait=True)
    if already is not None:
        return _done(f"the relay is held already: {already}")
    return _done(f"the relay is held; stopped: {_names(held)}")


def _resume(relay: RelayExecutor) -> ControlReply:
    if blocking := relay.blocking():
        words = ", ".join(f"release {name} or skip {name}" for name in blocking)
        return _refused(f"not resumed: {_names(blocking)} is not the service's to fly; first {words}")
    if lost := sorted(set(relay.unreached.values())):
        words = ", ".join(f"takeover {node}" for node in lost)
        return _refused(
            f"not resumed: {_names(sorted(relay.unreached))} cannot be reached; first {words}, or skip each"
        )
    held = relay.held
    told = relay.resume()
    if held is None and not told:
        return _refused("nothing is held")
    return _done(f"the relay goes on; located anew: {_names(told)}")


def _abort(relay: RelayExecutor) -> ControlReply:
    return _done(f"the relay ends; stopped: {_names(relay.abort(STOPPED))}")


def _skip(relay: RelayExecutor, name: str) -> ControlReply:
    record = relay.records.get(name)
    if record is None and name not in relay.standing.given:
        return _unknown(relay, name)
    if name in relay.given_up:
        return _refused(f"{name} has been given up already")
    if name not in relay.taken and name not in relay.unreached and (record is None or record.state in ENDED):
        return _refused(f"{name} stands where it should: there is nothing to give up")
    relay.give_up(name, "given up by the operator")
    told = relay.users(name)
    others = f"; it is planned for {_names(told)}: another way is looked for in their turn" if told else ""
    hovers = "" if name in relay.taken else "; it hovers: land it from another station"
    return _done(f"{name} is given up{hovers}{others}")


def _release(relay: RelayExecutor, name: str) -> ControlReply:
    lease, record = relay.leases.get(name), relay.records.get(name)
    if lease is None:
        return _unknown(relay, name)
    if name not in relay.taken:
        return _refused(f"{name} is the service's already")
    if record is None and (problem := relay.objection(name)) is not None:
        return _refused(f"{name} is not released, it cannot be trusted to stand: {problem}")
    if (problem := lease.release()) is not None:
        return _refused(f"{name} is not released: {problem}")
    relay.look()
    if name in relay.given_up:
        after = "it stays given up"
    elif record is None:
        after = "it is taken to stand at its place: when it does not, skip what needs it or abort"
    else:
        after = "resume brings it on from where it is"
    return _done(f"{name} is released and hovers; {after}")


_OF_ALL: dict[str, Callable[[RelayExecutor], ControlReply]] = {"hold": _hold, "resume": _resume, "abort": _abort}
_OF_ONE: dict[str, Callable[[RelayExecutor, str], ControlReply]] = {"skip": _skip, "release": _release}
VERBS = (*_OF_ALL, *_OF_ONE, TAKEOVER)


def _done(message: str) -> ControlReply:
    return ControlReply(ok=True, message=message)


def _refused(message: str) -> ControlReply:
    return ControlReply(ok=False, message=message)


def _unknown(relay: RelayExecutor, name: str) -> ControlReply:
    return _refused(f"there is no {name} in this relay, but {_names(sorted({*relay.leases, *relay.records}))}")


def _names(names: list[str]) -> str:
    return ", ".join(names) or "nobody"


@dataclass
class ControlDesk:
    """Answers the requests that come off the bus, one after another; `say` puts each before whoever watches."""

    relay: RelayExecutor
    say: Callable[[str], None]
    done: int = 0
    refused: int = 0
    malformed: int = 0

    def answer(self, payload: bytes) -> bytes:
        """Return the ControlReply to a ControlRequest, both as they are on the bus."""
        try:
            request = decode(payload, ControlRequest)
        except MalformedMessageError as error:
            self.malformed += 1
            return encode(_refused(f"no control request: {error}"))
        reply = carry_out(request, self.relay)
        self.done += reply.ok
        self.refused += not reply.ok
        word = " ".join(filter(None, (request.verb, request.vehicle)))
        self.say(f"operator: {word}: {reply.message}")
        return encode(reply)
