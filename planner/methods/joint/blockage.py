"""Blockage: why receivers could not be placed, in words."""

from __future__ import annotations

from itertools import islice

import numpy as np

from planner.errors import Obstruction
from planner.methods.joint.passage import passages
from planner.methods.joint.search import Outcome, State
from planner.methods.joint.trips import HOPELESS, Trips


def obstructions(trips: Trips, outcome: Outcome) -> tuple[Obstruction, ...]:
    """Return one obstruction for every receiver the search left waiting without a way to its slot."""
    receivers, slots = list(trips.problem.receivers), list(trips.problem.slots)
    return tuple(
        Obstruction(receivers[trips.receiver[trip]], slots[trips.slot[trip]], _reason(trips, outcome.state, int(trip)))
        for trip in np.flatnonzero(outcome.state.open)
    )


def _reason(trips: Trips, state: State, trip: int) -> str:
    problem = trips.problem
    if any(True for _ in islice(passages(trips, trip, state.standing, state.waiting, wide=True), 1)):
        return f"no route it can fly keeps the predicted placement error within {problem.tolerance_3sigma_m:g} m"
    if state.guides.length_ratio()[trip] >= HOPELESS:
        return "no two transmitters give lines of bearing that meet: they are parallel or one line with the slot"
    names = list(problem.transmitters) + [f"slot {name}" for name in problem.slots]
    stations = np.flatnonzero(trips.station_in_the_way[trip] & state.standing)
    starts = np.flatnonzero(trips.start_in_the_way[trip] & state.waiting)
    standing = [names[k] for k in stations] + [list(problem.receivers)[k] for k in starts]
    if standing:
        return f"blocked: {', '.join(standing)} in the way, and every way round comes too near something"
    return "blocked: every route comes too near a UAV, leaves the fence or has too long a leg"
