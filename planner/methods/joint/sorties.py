"""Sorties: groups of receivers that fly at the same time along what stands before they start."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np

from planner.accuracy import RelayErrors
from planner.landing import Landing
from planner.methods.joint.passage import Passage, passages
from planner.methods.joint.stops import landing_of, within_tolerance
from planner.methods.joint.trips import Indices, Mask, Trips
from planner.methods.joint.waves import paths_too_close
from planner.relay_accuracy import noise_of

_ROUTES_TRIED = 8


@dataclass(frozen=True)
class _Candidate:
    """A receiver that could fly now."""

    passage: Passage
    landing: Landing


def fly_in_sorties(trips: Trips, detour: float, beacons: Indices | None = None) -> list[list[Passage]] | None:
    """Return the sorties that place every receiver, None when they get stuck.

    In each, every receiver flies whose route is at most 1 + `detour` times its straight line, the longest first, as
    far as their paths keep apart; when there is none, the one with the least detour flies alone. With `beacons`, the
    trips numbered so are flown first, and afterwards nobody else transmits. `trips` has one trip for each receiver.
    """
    transmitters = np.arange(trips.stations.size) < len(trips.problem.transmitters)
    on_air = np.ones_like(transmitters)
    groups = [np.arange(trips.receiver.size)]
    if beacons is not None:
        on_air = transmitters.copy()
        on_air[trips.end_station[beacons]] = True
        groups = [beacons, np.setdiff1d(groups[0], beacons)]
    standing, waiting = transmitters.copy(), np.ones(trips.starts.size, dtype=np.bool_)
    errors = RelayErrors(trips.stations, noise_of(trips.problem))
    sorties: list[list[Passage]] = []
    for group in groups:
        while (left := group[waiting[trips.receiver[group]]]).size:
            sortie = _next_sortie(trips, left, detour, standing, on_air, waiting, errors)
            if not sortie:
                return None
            for candidate in sortie:
                trip = candidate.passage.trip
                waiting[trips.receiver[trip]], standing[trips.end_station[trip]] = False, True
                errors.place(int(trips.end_station[trip]), candidate.landing.error)
            sorties.append([candidate.passage for candidate in sortie])
    return sorties


def _next_sortie(
    trips: Trips, left: Indices, detour: float, standing: Mask, on_air: Mask, waiting: Mask, errors: RelayErrors
) -> list[_Candidate]:
    ready: list[_Candidate] = []
    spare: list[_Candidate] = []
    for trip in left:
        candidate = _candidate(trips, int(trip), standing, on_air, waiting, errors)
        if candidate is not None:
            direct = candidate.passage.length_m <= (1.0 + detour) * trips.distance_m[trip]
            (ready if direct else spare).append(candidate)
    if not ready:
        return [min(spare, key=lambda c: c.passage.length_m / trips.distance_m[c.passage.trip])] if spare else []
    ready.sort(key=lambda candidate: -candidate.passage.length_m)
    starts, ends = (np.array([at(trips, c.passage) for c in ready]) for at in (_start, _end))
    turns = np.array([candidate.passage.turning_point for candidate in ready])
    close = paths_too_close(np.stack([starts, turns, ends], axis=1), trips.problem.min_separation_m)
    chosen: list[int] = []
    for k in range(len(ready)):
        if not close[k, chosen].any():
            chosen.append(k)
    return [ready[k] for k in chosen]


def _candidate(
    trips: Trips, trip: int, standing: Mask, on_air: Mask, waiting: Mask, errors: RelayErrors
) -> _Candidate | None:
    """Return the trip's shortest route that can be flown now, dependably and accurately enough.

    Without a tolerance a route is taken that cannot be depended on where there is no other.
    """
    spare: _Candidate | None = None
    for passage in islice(passages(trips, trip, standing, waiting, on_air=on_air), _ROUTES_TRIED):
        landing = landing_of(trips, passage, standing & on_air, errors)
        if landing is None:
            continue
        if within_tolerance(trips, landing):
            return _Candidate(passage, landing)
        if trips.problem.tolerance_3sigma_m is None and spare is None:
            spare = _Candidate(passage, landing)
    return spare


def _start(trips: Trips, passage: Passage) -> complex:
    return complex(trips.starts[trips.receiver[passage.trip]])


def _end(trips: Trips, passage: Passage) -> complex:
    return complex(trips.slots[trips.slot[passage.trip]])
