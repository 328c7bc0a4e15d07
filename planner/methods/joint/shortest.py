"""The shortest plan: beam search, restarted with other assignments when it gets stuck."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from planner.accuracy import RelayErrors
from planner.errors import InfeasiblePlanError
from planner.methods.joint.blockage import obstructions
from planner.methods.joint.passage import Passage
from planner.methods.joint.search import Outcome, beam_search, first_state
from planner.methods.joint.trips import Trips, all_trips, shortest_trips, trips_of
from planner.relay import RelayProblem
from planner.relay_accuracy import noise_of

_ALL_PAIRS_UP_TO = 81
"""Receiver-slot pairs up to which the assignment is searched with the order."""
_WIDEST = 50
_EFFORT = 20_000
"""States times squared receivers: the width of the beam shrinks as receivers are added."""
_DEAR_RATIO, _WIDER = 1.1, 4
"""A small swarm's plan that a tight tolerance makes this much longer than straight is searched again, so much wider."""
_URGENCY_RATIO = 1.0
_RESTARTS = 30
_FEW_RESTARTS = 3
"""Another assignment clears a way more often than it makes a stop accurate; small swarms are searched well anyway."""
_SMALL = 30
_PENALTY_RATIO = 2.0

_WAY_OUT = (
    "Lower the separation, move a start, add a transmitter, or let one of the standing UAVs step aside or the "
    "receiver fly a third leg."
)


def shortest_passages(problem: RelayProblem) -> tuple[Trips, list[Passage]]:
    """Return the trips and, in flying order, the passages of the shortest plan found.

    Up to 81 receiver-slot pairs the assignment is part of the search, beyond it is the Hungarian one. When the search
    gets stuck it is restarted a few times (squeaky wheel): slots left free are to be filled sooner, or pairs that
    proved blocked are made dearer to assign. Raises InfeasiblePlanError naming every receiver that stayed blocked.
    """
    receivers, slots = len(problem.receivers), len(problem.slots)
    stuck: list[tuple[Trips, Outcome]] = []
    for attempts in (_sooner, _otherwise) if receivers * slots <= _ALL_PAIRS_UP_TO else (_otherwise,):
        for trips, outcome in attempts(problem):
            if outcome.complete:
                return trips, outcome.passages
            stuck.append((trips, outcome))
    raise InfeasiblePlanError(obstructions(*max(stuck, key=lambda one: len(one[1].passages))), _WAY_OUT)


def _sooner(problem: RelayProblem) -> Iterator[tuple[Trips, Outcome]]:
    """Yield searches over all pairs, the slots that stayed free in one favoured in the next."""
    trips = all_trips(problem)
    favour_m = np.zeros(trips.slots.size)
    for _ in range(1 + _FEW_RESTARTS):
        favoured = replace(trips, potential_m=trips.potential_m + favour_m[trips.slot])
        outcome = _search(favoured)
        yield favoured, outcome
        favour_m[np.unique(trips.slot[outcome.state.open])] += float(np.mean(trips.distance_m))


def _otherwise(problem: RelayProblem) -> Iterator[tuple[Trips, Outcome]]:
    """Yield searches with one assignment each, the pairs that were blocked in one made dearer in the next."""
    trips = shortest_trips(problem)
    cost_m = np.abs(trips.starts[:, None] - trips.slots[None, :])
    few = len(problem.receivers) <= _SMALL or problem.tolerance_3sigma_m is not None
    for _ in range(1 + (_FEW_RESTARTS if few else _RESTARTS)):
        outcome = _search(trips)
        yield trips, outcome
        blocked = np.flatnonzero(outcome.state.open)
        cost_m[trips.receiver[blocked], trips.slot[blocked]] += _PENALTY_RATIO * problem.min_separation_m + 1.0
        trips = trips_of(problem, *linear_sum_assignment(cost_m))


def _search(trips: Trips) -> Outcome:
    problem, count = trips.problem, trips.starts.size
    errors = None if problem.tolerance_3sigma_m is None else RelayErrors(trips.stations, noise_of(problem))
    width = max(1, min(_WIDEST, _EFFORT // count**2))
    urgency_m = np.full(count, _URGENCY_RATIO * problem.min_separation_m)
    outcome = beam_search(trips, first_state(trips, errors), width, urgency_m)
    straight_m = float(np.sum(trips.distance_m[trips.straight[trips.straight >= 0]]))
    dear = outcome.complete and outcome.state.length_m > _DEAR_RATIO * straight_m
    if errors is None or not dear or count * trips.slots.size > _ALL_PAIRS_UP_TO:
        return outcome
    wider = beam_search(trips, first_state(trips, errors), _WIDER * width, urgency_m)
    return min(outcome, wider, key=lambda one: (not one.complete, one.state.length_m))
