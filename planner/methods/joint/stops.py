"""Stop references of a route: the pairs of transmitters that leave the least error where it ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.accuracy import Indices, LegLine, RelayErrors, bearing_gradient, vector
from planner.landing import Landing, land
from planner.methods.joint.passage import Passage
from planner.methods.joint.trips import Mask, Trips
from planner.trimming import trim

_CANDIDATES_PER_SIDE = 9
_NO_LEG_RATIO = 1e-9
"""A leg shorter than this part of its route is not flown."""


def landing_of(trips: Trips, passage: Passage, standing: Mask, errors: RelayErrors) -> Landing | None:
    """Return the stops that place the receiver best, None when some leg has no usable stop reference."""
    start, target = trips.starts[trips.receiver[passage.trip]], trips.slots[trips.slot[passage.trip]]
    legs = _legs_of(passage, complex(start), complex(target))
    landing = land(errors, legs, [_sensitive(trips, standing, leg) for leg in legs])
    if landing is None or not trips.problem.map_trim or not legs:
        return landing
    error, _ = trim(errors, landing.error, complex(target), np.array(landing.transmitters))
    return replace(landing, error=error)


def within_tolerance(trips: Trips, landing: Landing) -> bool:
    """Return whether the receiver ends within the tolerance, if there is one, and that can be relied on."""
    limit_m = trips.problem.tolerance_3sigma_m
    return landing.dependable and (limit_m is None or landing.error.worst_axis_3sigma_m <= limit_m)


def _legs_of(passage: Passage, start: complex, target: complex) -> list[LegLine]:
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
    turn = bearing_gradient(leg.end, trips.stations[stations]) @ vector(leg.direction)
    ranked = np.argsort(turn, kind="stable")
    return np.concatenate([stations[ranked[:_CANDIDATES_PER_SIDE]], stations[ranked[-_CANDIDATES_PER_SIDE:]]])
