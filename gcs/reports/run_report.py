"""report.json: what became of a run, in the form other tools read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from drivers.mavlink.link_status import LinkStatus
from gcs.expectations.verdicts import Verdict
from gcs.recording.score import Score
from gcs.relay.records import ReceiverRecord
from gcs.report_checks import BearingCounters
from planner.plan import RelayPlan

Outcome = Literal["formed", "completed", "aborted", "failed"]


@dataclass(frozen=True)
class RunFigures:
    """The figures of a run beside its records."""

    playbook: str
    outcome: Outcome
    duration_s: float
    emission_transmitter_s: float
    bearing_reports: BearingCounters
    links: Sequence[tuple[str, LinkStatus]] = ()
    """Each with the names of the vehicles behind it."""
    stages: Sequence[Mapping[str, Any]] = ()
    """What became of each stage: name, kind, outcome, began_s, ended_s, reason."""
    verdicts: Sequence[Verdict] = ()
    setpoints_after_takeover: Mapping[str, int] = field(default_factory=dict)
    """Of each receiver that a pilot has had: what it was sent meanwhile."""


def run_report(
    figures: RunFigures, plan: RelayPlan, records: Mapping[str, ReceiverRecord], score: Score
) -> dict[str, Any]:
    """Return the documented report.json object: metres, seconds, degrees; null where nothing was flown."""
    return {
        "playbook": figures.playbook,
        "outcome": figures.outcome,
        "planned_total_length_m": plan.total_length_m,
        "flown_total_length_m": sum(score.leg_lengths_m.values()),
        "straight_line_bound_m": plan.straight_line_bound_m,
        "min_separation_m": score.min_separation_m,
        "duration_s": figures.duration_s,
        "emission_transmitter_s": figures.emission_transmitter_s,
        "bearing_reports": asdict(figures.bearing_reports),
        "links": [_link(vehicles, status) for vehicles, status in figures.links],
        "receivers": [
            _receiver(record, score, figures.setpoints_after_takeover.get(record.name)) for record in records.values()
        ],
        "stages": [dict(stage) for stage in figures.stages],
        "verdicts": [verdict.to_json() for verdict in figures.verdicts],
    }


def _link(vehicles: str, status: LinkStatus) -> dict[str, Any]:
    counted = ("received", "sent", "lost", "refused", "dropped", "skipped_bytes")
    link = {"vehicles": vehicles, "address": status.address, "state": status.state.value}
    return {**link, **{name: getattr(status, name) for name in counted}}


def _receiver(record: ReceiverRecord, score: Score, setpoints_after_takeover: int | None) -> dict[str, Any]:
    return {
        "name": record.name,
        "slot": record.route.slot,
        "state": record.state.value,
        "reason": record.reason,
        "route_model": record.route.model,
        "transmitters": list(record.route.transmitters),
        "placement_error_m": score.placement_error_m(record),
        "overshoot_m": score.overshoot_m(record),
        "setpoints_after_takeover": setpoints_after_takeover,
        "legs": [_leg(record, number, score) for number in range(len(record.route.legs))],
    }


def _leg(record: ReceiverRecord, number: int, score: Score) -> dict[str, Any]:
    planned = record.route.legs[number]
    flown = record.legs[number] if number < len(record.legs) else None
    ended = flown is not None and flown.ended_s is not None
    error_rad = None if flown is None else flown.stop_angle_error_rad
    return {
        "planned_length_m": planned.length_m,
        "flown_length_m": score.leg_lengths_m[record.name, number] if flown is not None else None,
        "stop_angle_deg": math.degrees(planned.stop_angle_rad),
        "stop_angle_error_deg": None if error_rad is None else math.degrees(error_rad),
        "outliers": None if flown is None else flown.outliers,
        "duration_s": flown.ended_s - flown.started_s if ended and flown is not None and flown.ended_s else None,
    }
