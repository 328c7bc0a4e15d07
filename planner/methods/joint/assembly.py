"""Assembly: from passages in the order they are flown to a relay plan with stop references, accuracy and waves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planner.accuracy import RelayErrors
from planner.assignment import straight_line_bound
from planner.errors import InfeasiblePlanError, Obstruction
from planner.methods.joint.passage import Passage
from planner.methods.joint.stops import landing_of
from planner.methods.joint.trips import Mask, Trips
from planner.methods.joint.waves import wave_of_each
from planner.plan import RelayPlan, Route
from planner.relay import emission_transmitter_s, makespan_s
from planner.relay_accuracy import noise_of
from planner.routes import make_leg

_WAY_OUT = "Add a transmitter off the line of the others, or move the start."


def assemble(trips: Trips, sorties: Sequence[Sequence[Passage]], on_air: Mask | None = None) -> RelayPlan:
    """Return the plan that flies these sorties one after the other; a sortie uses what stands before it.

    `on_air`, shape (K,), limits the transmitters that stop references may use; None: all that stand. Raises
    InfeasiblePlanError when a leg has no stop reference.
    """
    problem = trips.problem
    relay = _Relay(trips)
    routes: list[Route] = []
    for sortie in sorties:
        standing = relay.standing.copy() if on_air is None else relay.standing & on_air
        routes.extend([relay.fly(passage, standing, len(routes) + k) for k, passage in enumerate(sortie, start=1)])
    waves = wave_of_each(problem, routes)
    flown = tuple(replace(route, wave=wave) for route, wave in zip(routes, waves, strict=True))
    return RelayPlan(
        method="joint",
        routes=flown,
        straight_line_bound_m=straight_line_bound(trips.starts, trips.slots),
        makespan_s=makespan_s(problem, flown),
        emission_transmitter_s=emission_transmitter_s(problem, flown),
    )


class _Relay:
    """Who stands where so far, by name, and with what error."""

    def __init__(self, trips: Trips) -> None:
        problem = trips.problem
        self._trips = trips
        self._errors = RelayErrors(trips.stations, noise_of(problem))
        self._names = list(problem.transmitters) + [""] * trips.slots.size
        self._receivers, self._slots = list(problem.receivers), list(problem.slots)
        self.standing = np.arange(trips.stations.size) < len(problem.transmitters)

    def fly(self, passage: Passage, standing: Mask, order: int) -> Route:
        """Return the route of a passage, and let its receiver stand in the slot."""
        trips, trip = self._trips, passage.trip
        receiver, slot = self._receivers[trips.receiver[trip]], self._slots[trips.slot[trip]]
        landing = landing_of(trips, passage, standing, self._errors)
        if landing is None:
            blind = Obstruction(receiver, slot, "no pair of transmitters changes its angle along a leg")
            raise InfeasiblePlanError((blind,), _WAY_OUT)
        legs = tuple(
            make_leg(
                stop.leg.begin,
                stop.leg.end,
                self._station(stop.leg.guide),
                (self._station(stop.reference[0]), self._station(stop.reference[1])),
            )
            for stop in landing.stops
        )
        placed = int(trips.end_station[trip])
        self._errors.place(placed, landing.error)
        self.standing[placed], self._names[placed] = True, receiver
        start, target = complex(trips.starts[trips.receiver[trip]]), complex(trips.stations[placed])
        predicted_m = landing.error.worst_axis_3sigma_m
        return Route(receiver, slot, order, order, "general", start, target, legs, predicted_m)

    def _station(self, number: int) -> tuple[str, complex]:
        return self._names[number], complex(self._trips.stations[number])
