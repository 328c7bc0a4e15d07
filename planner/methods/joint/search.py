"""Beam search over the order of placements: which receiver flies to which slot next, and along which guides.

A state is what has been placed so far. Its bound is the length flown plus the least the rest could cost with every
station transmitting; of all successors the `width` best are kept, one for each set placed. Successors are
ranked by their optimistic lengths and given a real route, clear of everything and accurate enough, only when their
turn comes. Width 1 is the greedy method.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from planner.accuracy import PositionError, RelayErrors
from planner.methods.joint.guides import BestGuides, first_guides
from planner.methods.joint.passage import Passage, passages
from planner.methods.joint.stops import landing_of, within_tolerance
from planner.methods.joint.trips import Mask, Reals, Trips

_PASSAGES_TRIED = 12
"""Routes whose accuracy is looked at before a placement is given up."""
_SMALL = 30
_WIDE_UP_TO = 3
"""Receivers still waiting up to which a larger swarm looks at roundabout routes: another assignment is quicker."""
_LAST_RESORT_M = 1e12
_SURCHARGE_RATIO = 0.5
"""Separations charged to a trip while its straight way is obstructed: others may clear it first."""


@dataclass(frozen=True)
class History:
    """The placements that led to a state, newest first."""

    passage: Passage
    before: History | None

    def in_order(self) -> list[Passage]:
        """Return the placements, oldest first."""
        ordered: list[Passage] = []
        history: History | None = self
        while history is not None:
            ordered.append(history.passage)
            history = history.before
        return ordered[::-1]


@dataclass(frozen=True)
class State:
    """Who has been placed where."""

    waiting: Mask
    standing: Mask
    open: Mask
    """Shape (r,): trips whose receiver waits and whose slot is free."""
    obstructed: Mask
    """Shape (r,): trips whose straight way passes too close to a station that stands by now."""
    guides: BestGuides
    length_m: float
    bound_m: float
    placed: int
    """The receivers placed and, above them, the slots filled, one bit each."""
    history: History | None
    errors: RelayErrors | None


@dataclass(frozen=True)
class _Placement:
    """A successor's route, and the error it leaves where that matters."""

    passage: Passage
    error: PositionError | None


@dataclass(frozen=True)
class Outcome:
    """How far the search came: all placed, or the state no successor was found for."""

    state: State
    complete: bool

    @property
    def passages(self) -> list[Passage]:
        """The placements in the order they are flown."""
        return self.state.history.in_order() if self.state.history else []


def first_state(trips: Trips, errors: RelayErrors | None) -> State:
    """Return the state before anything has been flown."""
    transmitters = len(trips.problem.transmitters)
    return State(
        waiting=np.ones(trips.starts.size, dtype=np.bool_),
        standing=np.arange(trips.stations.size) < transmitters,
        open=np.ones(trips.receiver.size, dtype=np.bool_),
        obstructed=np.any(trips.station_in_the_way[:, :transmitters], axis=1),
        guides=first_guides(trips),
        length_m=0.0,
        bound_m=0.0,
        placed=0,
        history=None,
        errors=errors,
    )


def beam_search(trips: Trips, state: State, width: int, urgency_m: Reals) -> Outcome:
    """Return the best complete state found, or one of those that could not be continued.

    `urgency_m`, shape (n,), is charged for a receiver for as long as it waits with its straight way obstructed.
    """
    states = [state]
    for _ in range(int(np.count_nonzero(state.standing)) - len(trips.problem.transmitters), trips.rounds):
        successors = list(_best_successors(trips, states, width, urgency_m))
        if not successors:
            return Outcome(states[0], complete=False)
        states = successors
    return Outcome(min(states, key=lambda found: found.length_m), complete=True)


def _best_successors(trips: Trips, states: list[State], width: int, urgency_m: Reals) -> Iterator[State]:
    """Yield up to `width` successors of the states, the least bound first, one for each set placed."""
    queue: list[tuple[float, int, int, bool, _Placement | None]] = []
    for k, state in enumerate(states):
        estimates_m = _estimates_m(trips, state, urgency_m)
        queue.extend((float(estimates_m[trip]), k, int(trip), False, None) for trip in np.flatnonzero(state.open))
    heapq.heapify(queue)
    kept: set[int] = set()
    while queue and len(kept) < width:
        estimate_m, k, trip, wide, placement = heapq.heappop(queue)
        state = states[k]
        placed = state.placed | 1 << int(trips.receiver[trip]) | 1 << trips.starts.size + int(trips.slot[trip])
        if placed in kept:
            continue
        if placement is not None:
            kept.add(placed)
            yield _successor(trips, state, placement, placed, copy=width > 1)
        elif (placement := _place(trips, state, trip, wide=wide)) is not None:
            surplus_m = placement.passage.length_m - float(_optimistic_m(trips, state)[trip])
            heapq.heappush(queue, (estimate_m + max(0.0, surplus_m), k, trip, wide, placement))
        elif not wide and (trips.starts.size <= _SMALL or np.count_nonzero(state.waiting) <= _WIDE_UP_TO):
            heapq.heappush(queue, (estimate_m + _LAST_RESORT_M, k, trip, True, None))


def _optimistic_m(trips: Trips, state: State) -> Reals:
    """Return the length of every trip by the best guides that stand, as if nothing were in its way."""
    return trips.distance_m * state.guides.length_ratio()


def _estimates_m(trips: Trips, state: State, urgency_m: Reals) -> Reals:
    """Return the least total length conceivable after each trip, and the charge for whom it leaves obstructed."""
    charged = np.flatnonzero(state.waiting & (trips.straight >= 0))
    straight = trips.straight[charged]
    obstructed = state.obstructed[straight]
    left_m = np.zeros(trips.starts.size)
    left_m[charged] = np.where(obstructed, -urgency_m[charged], 0.0)
    newly_m = np.where(obstructed, 0.0, urgency_m[charged]) @ trips.station_in_the_way[straight]
    charge_m = left_m[trips.receiver] - left_m.sum() + newly_m[trips.end_station]
    in_the_way = state.obstructed | (trips.start_in_the_way @ state.waiting)
    surcharge_m = np.where(in_the_way, _SURCHARGE_RATIO * trips.problem.min_separation_m, 0.0)
    return np.asarray(state.bound_m + _optimistic_m(trips, state) - trips.potential_m + charge_m + surcharge_m)


def _place(trips: Trips, state: State, trip: int, *, wide: bool) -> _Placement | None:
    """Return the shortest route of the trip that can be flown and is accurate enough, None if there is none."""
    for passage in islice(passages(trips, trip, state.standing, state.waiting, wide=wide), _PASSAGES_TRIED):
        if state.errors is None:
            return _Placement(passage, None)
        landing = landing_of(trips, passage, state.standing, state.errors)
        if landing is not None and within_tolerance(trips, landing):
            return _Placement(passage, landing.error)
    return None


def _successor(trips: Trips, state: State, placement: _Placement, placed: int, *, copy: bool) -> State:
    passage = placement.passage
    receiver, station = trips.receiver[passage.trip], int(trips.end_station[passage.trip])
    waiting, standing = state.waiting.copy(), state.standing.copy()
    waiting[receiver], standing[station] = False, True
    errors = state.errors
    if errors is not None and placement.error is not None:
        errors = errors.copy() if copy else errors
        errors.place(station, placement.error)
    return State(
        waiting=waiting,
        standing=standing,
        open=state.open & (trips.receiver != receiver) & (trips.end_station != station),
        obstructed=state.obstructed | trips.station_in_the_way[:, station],
        guides=state.guides.joined_by(station, trips.tangents[:, :, station]),
        length_m=state.length_m + passage.length_m,
        bound_m=state.bound_m + passage.length_m - float(trips.potential_m[passage.trip]),
        placed=placed,
        history=History(passage, state.history),
        errors=errors,
    )
