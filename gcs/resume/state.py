"""How far a run had come when its service ended, as its journal tells, and what the relay goes on from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from gcs.recording.journal_reading import Change, Entry, Said
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import ReceiverState
from planner.plan import RelayPlan, Route

NOBODY: Final[Mapping[str, str]] = MappingProxyType({})


@dataclass(frozen=True)
class RunState:
    """How far a run had come."""

    receivers: Mapping[str, Change]
    """What the journal says of each receiver last."""
    placed: tuple[str, ...]
    """Who stood in their slots, in the order in which they came to stand."""
    taken: frozenset[str]
    """The vehicles that were their pilots'."""
    given_up: frozenset[str]


@dataclass(frozen=True)
class Restored:
    """What a relay goes on from: the records of its receivers, and what its executor has to know besides."""

    records: dict[str, ReceiverRecord]
    unverified: tuple[str, ...]
    """Who is located before anybody flies, in this order."""
    given_up: frozenset[str]
    """Who is done without: receivers are FAILED, transmitters are not used."""
    withheld: frozenset[str]
    """The vehicles that were their pilots' and have not been released."""
    changed: tuple[str, ...]
    """The receivers of whom the journal says something else last."""


def run_state(entries: Iterable[Entry]) -> RunState:
    """Return how far a run had come, from the entries of its journal in order."""
    receivers: dict[str, Change] = {}
    placed: list[str] = []
    taken = given_up = frozenset[str]()
    for entry in entries:
        if isinstance(entry, Said):
            if entry.known is not None:
                taken, given_up = entry.known.taken, entry.known.given_up
        elif isinstance(entry, Change):
            receivers[entry.receiver] = entry
            stands, stood = entry.state is ReceiverState.PLACED, entry.receiver in placed
            if stands and not stood:
                placed.append(entry.receiver)
            elif stood and not stands:
                placed.remove(entry.receiver)
    return RunState(receivers, tuple(placed), taken, given_up)


def restored(plan: RelayPlan, state: RunState, without: Mapping[str, str] = NOBODY) -> Restored:
    """Return what the relay goes on from; `without` are the vehicles it does without from now on, with the reason.

    Who was on its way is HELD where it is now, and flies alone from there: nobody knows how far it had come.
    """
    last = state.receivers
    failed = {name for name, entry in last.items() if entry.state is ReceiverState.FAILED}
    piloted = {name for name, entry in last.items() if entry.state is ReceiverState.PILOT}
    reasons = dict.fromkeys(state.given_up, "given up before the service ended") | dict(without)
    given_up = reasons.keys() | failed
    records = {
        route.receiver: _record(route, last.get(route.receiver), reasons.get(route.receiver)) for route in plan.routes
    }
    on_their_way = [name for name, record in records.items() if record.state is ReceiverState.HELD]
    return Restored(
        records=records,
        unverified=tuple(name for name in (*state.placed, *on_their_way) if name in records and name not in given_up),
        given_up=frozenset(given_up),
        withheld=(state.taken | piloted) - given_up,
        changed=tuple(name for name, record in records.items() if _differs(record, last.get(name))),
    )


def _record(route: Route, last: Change | None, given_up: str | None) -> ReceiverRecord:
    if last is None:
        record = ReceiverRecord(route)
    else:
        record = ReceiverRecord(
            last.route or route, last.state, last.reason, place=last.place, covariance=last.covariance
        )
    if given_up is not None and record.state is not ReceiverState.FAILED:
        record.state, record.reason = ReceiverState.FAILED, given_up
    elif record.state not in (ReceiverState.WAITING, ReceiverState.PLACED, ReceiverState.FAILED):
        if record.state is not ReceiverState.HELD:
            record.reason = f"the service ended while it was in {record.state.value}"
        record.state, record.off_plan, record.strayed = ReceiverState.HELD, True, True
    return record


def _differs(record: ReceiverRecord, last: Change | None) -> bool:
    return record.state is not (ReceiverState.WAITING if last is None else last.state)
