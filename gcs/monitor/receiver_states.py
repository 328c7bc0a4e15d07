"""The receivers of a relay as screens show them: what is known of each leg from angles alone, and the time to go."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.bus.run_messages import LegState, ReceiverStatus
from gcs.monitor.leg_geometry import LegGeometry
from gcs.monitor.run_setup import place
from gcs.monitor.sources import RunSources
from gcs.monitor.timing import leg_to_go_s, times_to_go_s
from gcs.relay.records import LegRecord, ReceiverRecord
from gcs.relay.standing import worst_sigma_m
from gcs.relay.states import ReceiverState
from gcs.stop_monitor import SLOT, TURN


@dataclass
class Since:
    """When each receiver came into the state it is in, as seen from one look to the next."""

    _seen: dict[str, tuple[ReceiverState, float]] = field(default_factory=dict)

    def of(self, record: ReceiverRecord, now_s: float) -> float:
        """Return since when a receiver has been in its state: since a look found it there, s."""
        seen = self._seen.get(record.name)
        if seen is None or seen[0] is not record.state:
            seen = self._seen[record.name] = (record.state, now_s)
        return seen[1]


def receiver_states(sources: RunSources, since: Since) -> list[ReceiverStatus]:
    """Return every receiver in the order of the plan."""
    records = sources.status.records
    relay = sources.status.relay
    held = relay is not None and relay.held is not None
    to_go_s = {} if held else times_to_go_s(records, sources.pace)
    elapsed_s = sources.status.elapsed_s()
    return [
        ReceiverStatus(
            name=name,
            slot=record.route.slot,
            wave=record.route.wave,
            state=record.state.value,
            since_s=since.of(record, elapsed_s),
            reason=record.reason,
            bearings=sources.bearings(name),
            leg=None if record.leg is None else leg_state(record, record.leg, sources),
            legs=len(record.route.legs),
            to_go_s=to_go_s.get(name),
            place_m=None if record.place is None else place(record.place),
            place_sigma_m=None if record.covariance is None else worst_sigma_m(record.covariance),
        )
        for name, record in records.items()
    ]


def leg_state(record: ReceiverRecord, flown: LegRecord, sources: RunSources) -> LegState:
    """Return the leg that a receiver flies."""
    leg, estimate, number = flown.leg, flown.estimate, len(record.legs)
    rule = SLOT if number >= len(record.route.legs) else TURN
    band_rad, rate_radps = 0.0, None
    first, second = (sources.place_of(name) for name in leg.stop_reference)
    if first is not None and second is not None:
        geometry = LegGeometry(leg, first, second)
        band_rad = abs(geometry.gradient_radpm(leg.end)) * rule.band_m
        if estimate is not None:
            at = geometry.at(estimate.remaining_m, estimate.cross_track_m)
            rate_radps = geometry.gradient_radpm(at) * estimate.progress_mps
    return LegState(
        number=number,
        guide=leg.guide,
        direction=leg.direction,
        stop_reference=leg.stop_reference,
        stop_angle_rad=float(leg.stop_angle_rad),
        start_m=place(leg.start),
        end_m=place(leg.end),
        band_rad=band_rad,
        band_m=rule.band_m,
        angle_rad=flown.measured_angle_rad,
        rate_radps=rate_radps,
        remaining_m=None if estimate is None else estimate.remaining_m,
        cross_track_m=None if estimate is None else estimate.cross_track_m,
        progress_mps=None if estimate is None else estimate.progress_mps,
        sigma_m=None if estimate is None else estimate.remaining_sigma_m,
        to_go_s=leg_to_go_s(record, sources.pace),
    )
