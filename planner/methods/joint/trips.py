"""Trips: every receiver-to-slot pair the search may choose, with what each transmitter is worth to it as a guide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from planner.relay import RelayProblem
from planner.routes import SEPARATION_TOLERANCE_M, Points, distance_to_segment, half_angle_tangents

Reals = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

USELESS = 1e12
"""The tangent of a station that cannot guide a trip."""
HOPELESS = 1e9
"""The length ratio of a route whose lines do not meet."""


@dataclass(frozen=True)
class Trips:
    """The r trips of n receivers to m slots, and the K stations a guide may stand at: transmitters, then slots.

    `tangents`, shape (4, r, K), holds p, q, 1/p and 1/q of every station (see `half_angle_tangents`): the smaller, the
    straighter the route. `potential_m`, shape (r,), is what the trip costs in the assignment's dual: summed over any
    complete assignment it is the least total length conceivable with every station transmitting.
    """

    problem: RelayProblem
    starts: Points
    stations: Points
    receiver: Indices
    slot: Indices
    distance_m: Reals
    tangents: NDArray[np.float64]
    potential_m: Reals
    station_in_the_way: Mask
    """Shape (r, K): which stations a trip's straight way passes too close to, its own slot apart."""
    start_in_the_way: Mask
    """Shape (r, n): which receivers' starts it passes too close to, its own apart."""
    straight: Indices
    """Shape (n,): the trip of each receiver in the shortest assignment, -1 for one that has none."""

    @property
    def slots(self) -> Points:
        """The slots, shape (m,)."""
        return self.stations[len(self.problem.transmitters) :]

    @property
    def rounds(self) -> int:
        """How many receivers are placed in the end."""
        return min(self.starts.size, self.slots.size)

    @property
    def end_station(self) -> Indices:
        """The station each trip ends at, shape (r,)."""
        return len(self.problem.transmitters) + self.slot


def all_trips(problem: RelayProblem) -> Trips:
    """Return the trips of every receiver to every slot."""
    receiver, slot = np.indices((len(problem.receivers), len(problem.slots))).reshape(2, -1)
    return _trips(problem, receiver, slot)


def shortest_trips(problem: RelayProblem) -> Trips:
    """Return one trip for each receiver, or for each slot: the Hungarian assignment of straight distances."""
    return trips_of(problem, *linear_sum_assignment(_straight_m(problem)))


def trips_of(problem: RelayProblem, receiver: Indices, slot: Indices) -> Trips:
    """Return the trips given as receiver and slot indices."""
    return _trips(problem, receiver, slot)


def _trips(problem: RelayProblem, receiver: Indices, slot: Indices) -> Trips:
    starts, slots = np.array(list(problem.receivers.values())), np.array(list(problem.slots.values()))
    stations = np.concatenate([np.array(list(problem.transmitters.values())), slots])
    begin, end = starts[receiver], slots[slot]
    p, q = half_angle_tangents(begin[:, None], end[:, None], stations[None, :])
    tangents = np.stack([p, q, 1.0 / p, 1.0 / q])
    tangents[:, (stations[None, :] == begin[:, None]) | (stations[None, :] == end[:, None])] = USELESS
    distance_m = np.abs(end - begin)
    least_m = problem.min_separation_m - SEPARATION_TOLERANCE_M
    station_in_the_way = distance_to_segment(begin[:, None], end[:, None], stations[None, :]) < least_m
    start_in_the_way = distance_to_segment(begin[:, None], end[:, None], starts[None, :]) < least_m
    station_in_the_way[np.arange(receiver.size), len(problem.transmitters) + slot] = False
    start_in_the_way[np.arange(receiver.size), receiver] = False
    return Trips(
        problem=problem,
        starts=starts,
        stations=stations,
        receiver=receiver,
        slot=slot,
        distance_m=distance_m,
        tangents=tangents,
        potential_m=_potentials(distance_m * _best_ratio(tangents), receiver, slot, starts.size, slots.size),
        station_in_the_way=station_in_the_way,
        start_in_the_way=start_in_the_way,
        straight=_straight_trips(distance_m, receiver, slot, starts.size, slots.size),
    )


def length_ratio(product: Reals) -> Reals:
    """Return (1 + x) / (1 - x), HOPELESS from x = 1: how many times the straight line a route is long."""
    below = product < 1.0
    return np.asarray(np.where(below, (1.0 + product) / np.where(below, 1.0 - product, 1.0), HOPELESS))


def _best_ratio(tangents: Reals) -> Reals:
    """Return the least length ratio of each trip with every station transmitting; a guide may serve twice here."""
    p, q, inverse_p, inverse_q = tangents.min(axis=-1)
    return length_ratio(np.minimum(p * q, inverse_p * inverse_q))


def _straight_m(problem: RelayProblem) -> Reals:
    starts, slots = np.array(list(problem.receivers.values())), np.array(list(problem.slots.values()))
    return np.asarray(np.abs(starts[:, None] - slots[None, :]))


def _straight_trips(distance_m: Reals, receiver: Indices, slot: Indices, receivers: int, slots: int) -> Indices:
    """Return the trip of each receiver in the shortest assignment the trips allow."""
    number = np.full((receivers, slots), -1)
    number[receiver, slot] = np.arange(receiver.size)
    cost_m = np.full((receivers, slots), distance_m.sum() + 1.0)
    cost_m[receiver, slot] = distance_m
    rows, columns = linear_sum_assignment(cost_m)
    straight = np.full(receivers, -1)
    straight[rows] = number[rows, columns]
    return straight


def _potentials(cost_m: Reals, receiver: Indices, slot: Indices, receivers: int, slots: int) -> Reals:
    """Return u_i + v_j of every trip, u and v the optimal dual of the assignment over the given trips.

    With one trip for each receiver it is the cost itself. Otherwise the dual follows from the optimal assignment by
    relaxing the residual graph (Bellman-Ford).
    """
    if receiver.size == min(receivers, slots):
        return cost_m
    size = max(receivers, slots)
    square = np.zeros((size, size))
    square[:receivers, :slots] = 1e9
    square[receiver, slot] = np.minimum(cost_m, 1e9)
    _, column_of = linear_sum_assignment(square)
    matched = square[np.arange(size), column_of]
    u = np.zeros(size)
    for _ in range(size):
        v = (square - u[:, None]).min(axis=0)
        u = matched - v[column_of]
    return np.asarray(np.minimum(u[receiver] + v[slot], cost_m))
