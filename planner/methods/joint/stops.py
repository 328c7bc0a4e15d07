"""Stop references of a route: the pairs of transmitters that leave the least error where it ends."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from planner.accuracy import Indices, LegLine, PositionError, RelayErrors, Stop, bearing_gradient
from planner.methods.joint.passage import Passage
from planner.methods.joint.trips import Mask, Trips

_CANDIDATES_PER_SIDE = 9
_NO_LEG_RATIO = 1e-9
"""A leg shorter than this part of its route is not flown."""


@dataclass(frozen=True)
class Landing:
    """The stops of a route, one for each leg flown, and the error the receiver is left with in its slot."""

    stops: tuple[Stop, ...]
    error: PositionError

    def within(self, limit_m: float) -> bool:
        """Whether the receiver ends within the limit, three sigma along the worst axis, and that can be relied on."""
        return self.error.worst_axis_3sigma_m <= limit_m and all(stop.dependable for stop in self.stops)


def land(trips: Trips, passage: Passage, standing: Mask, errors: RelayErrors) -> Landing | None:
    """Return the stops that place the receiver best, None when some leg has no usable stop reference."""
    start, target = trips.starts[trips.receiver[passage.trip]], trips.slots[trips.slot[passage.trip]]
    legs = legs_of(passage, complex(start), complex(target))
    error = errors.at_start()
    stops: list[Stop] = []
    for leg, following in zip_longest(legs, legs[1:]):
        stop = errors.stop(error, leg, _sensitive(trips, standing, leg), following)
        if stop is None:
            return None
        stops.append(stop)
        error = stop.error
    if trips.problem.map_trim and stops:
        on_air = sorted({station for stop in stops for station in (stop.leg.guide, *stop.reference)})
        error, _ = errors.trim(error, complex(target), np.array(on_air))
    return Landing(tuple(stops), error)


def legs_of(passage: Passage, start: complex, target: complex) -> list[LegLine]:
    """Return each leg that is longer than nothing."""
    corners = (start, passage.turning_point, target)
    flown = [
        (guide, begin, end)
        for guide, begin, end in zip(passage.guides, corners, corners[1:], strict=False)
        if abs(end - begin) > _NO_LEG_RATIO * passage.length_m
    ]
    if len(flown) == 1:
        return [LegLine(flown[0][0], start, target)]
    return [LegLine(*leg) for leg in flown]


def _sensitive(trips: Trips, standing: Mask, leg: LegLine) -> Indices:
    """Return the standing stations whose bearings turn most either way along the leg; never one the leg ends at."""
    stations = np.flatnonzero(standing & (trips.stations != leg.end))
    if stations.size <= 2 * _CANDIDATES_PER_SIDE:
        return stations
    turn = bearing_gradient(leg.end, trips.stations[stations]) @ np.array([leg.direction.real, leg.direction.imag])
    ranked = np.argsort(turn, kind="stable")
    return np.concatenate([stations[ranked[:_CANDIDATES_PER_SIDE]], stations[ranked[-_CANDIDATES_PER_SIDE:]]])
