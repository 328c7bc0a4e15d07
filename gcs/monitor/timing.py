"""How long the relay takes: as planned, and from where it is now. Estimates for screens; nothing is flown by them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from gcs.relay.records import ReceiverRecord
from gcs.relay.states import ReceiverState
from planner.plan import Leg, Route

_S = ReceiverState


@dataclass(frozen=True)
class Pace:
    """How fast receivers come to their slots, beside the way they fly at `speed_mps`: as measured in calm air."""

    speed_mps: float
    locate_s: float = 1.1
    turn_s: float = 4.2
    """At the end of a leg that turns: slowing down, and arriving..."""
    slot_s: float = 5.5
    """...and of one that ends in the slot."""
    verify_s: float = 3.0

    def leg_s(self, length_m: float, *, last: bool) -> float:
        """Return how long a leg of this length takes, s."""
        return length_m / self.speed_mps + (self.slot_s if last else self.turn_s)

    def legs_s(self, legs: Sequence[Leg]) -> float:
        """Return how long the last legs of a route take, s."""
        return sum(self.leg_s(leg.length_m, last=leg is legs[-1]) for leg in legs)

    def route_s(self, route: Route) -> float:
        """Return how long a receiver takes for its whole route, s."""
        return self.locate_s + self.legs_s(route.legs) + self.verify_s


def planned_times_s(routes: Iterable[Route], pace: Pace) -> dict[str, tuple[float, float]]:
    """Return when each receiver begins and ends as planned, s since the relay began: wave after wave."""
    routes = list(routes)
    begins_s, times_s = 0.0, dict[str, tuple[float, float]]()
    for wave in sorted({route.wave for route in routes}):
        durations_s = {route.receiver: pace.route_s(route) for route in routes if route.wave == wave}
        times_s |= {name: (begins_s, begins_s + duration_s) for name, duration_s in durations_s.items()}
        begins_s += max(durations_s.values())
    return times_s


def times_to_go_s(records: Mapping[str, ReceiverRecord], pace: Pace) -> dict[str, float]:
    """Return in what time each receiver will stand in its slot, s, as far as it flies on without anybody's word.

    0 for one that does; those that are held, their pilot's or given up have none.
    """
    begins_s, times_s = 0.0, dict[str, float]()
    for wave in sorted({record.route.wave for record in records.values()}):
        of_wave = {
            name: own_time_s(record, pace)
            for name, record in records.items()
            if record.route.wave == wave and record.state not in (_S.HELD, _S.PILOT, _S.FAILED)
        }
        times_s |= {name: begins_s + own_s if own_s else 0.0 for name, own_s in of_wave.items()}
        begins_s += max(of_wave.values(), default=0.0)
    return times_s


def own_time_s(record: ReceiverRecord, pace: Pace) -> float:
    """Return how long a receiver still takes from when it is its turn, s."""
    state, legs = record.state, record.route.legs
    if state is _S.PLACED:
        return 0.0
    if state in (_S.VERIFYING, _S.TRIMMING):
        return pace.verify_s
    if state in (_S.LEG_1, _S.LEG_2):
        return leg_to_go_s(record, pace) + pace.legs_s(legs[len(record.legs) :]) + pace.verify_s
    return pace.route_s(record.route)


def leg_to_go_s(record: ReceiverRecord, pace: Pace) -> float:
    """Return how long the leg being flown still takes, s; 0 between legs."""
    leg = record.leg
    if leg is None:
        return 0.0
    remaining_m = leg.leg.length_m if leg.estimate is None else max(leg.estimate.remaining_m, 0.0)
    return pace.leg_s(remaining_m, last=len(record.legs) >= len(record.route.legs))
