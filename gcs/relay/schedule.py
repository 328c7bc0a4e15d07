"""Who flies next: wave after wave as planned, and alone whoever cannot keep to the plan any more."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from gcs.relay.records import ReceiverRecord
from gcs.relay.rerouting import passes_near
from gcs.relay.standing import Standing
from gcs.relay.states import ReceiverState


@dataclass(frozen=True)
class Departure:
    """Receivers that fly at the same time: as planned, or one alone by a route of its own."""

    records: tuple[ReceiverRecord, ...]
    alone: bool


def next_departure(
    records: Mapping[str, ReceiverRecord], resumed: Collection[str], standing: Standing, min_separation_m: float
) -> Departure | None:
    """Return who flies next of those WAITING, and of the HELD ones those `resumed`; None when nobody is left.

    The plan keeps the paths of a wave apart; a path found later is kept clear of what hovers, so it is flown alone.
    """
    ready = [
        record
        for name, record in records.items()
        if record.state is ReceiverState.WAITING or (record.state is ReceiverState.HELD and name in resumed)
    ]
    if not ready:
        return None
    wave = min(record.route.wave for record in ready)
    due = sorted((record for record in ready if record.route.wave == wave), key=lambda record: record.route.order)
    lost = {name: hovers_at(record) for name, record in records.items() if record.state is ReceiverState.FAILED}
    for record in due:
        as_planned = standing.hold(record.route.transmitters) and not passes_near(record.route, lost, min_separation_m)
        has_route = record.state is ReceiverState.WAITING or bool(record.route.legs)
        if record.off_plan or not as_planned or not has_route:
            return Departure((record,), alone=True)
    return Departure(tuple(due), alone=False)


def hovering_beside(name: str, records: Mapping[str, ReceiverRecord]) -> dict[str, complex]:
    """Return where all other receivers hover that do not stand in their slots, formation frame, m."""
    others = {other: record for other, record in records.items() if other != name}
    return {other: hovers_at(record) for other, record in others.items() if record.state is not ReceiverState.PLACED}


def hovers_at(record: ReceiverRecord) -> complex:
    """Return where bearings put a receiver last, or else its start, formation frame, m."""
    return record.route.start if record.place is None else record.place
