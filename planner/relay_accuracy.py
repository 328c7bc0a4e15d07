"""How accurately a given relay plan, of whatever method, places its receivers; and the trim leg that follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.accuracy import BearingNoise, LegLine, PositionError, RelayErrors
from planner.errors import InfeasiblePlanError, Obstruction
from planner.plan import RelayPlan
from planner.relay import RelayProblem


@dataclass(frozen=True)
class Trim:
    """The maximum-a-posteriori trim of one placement.

    A receiver standing in its slot measures the bearings of `transmitters` once more. Their surplus over the planned
    polar directions (rad, counter-clockwise, the common heading error included) times `gain`, shape (2, t), m/rad, is
    its estimated error (x, y) in the formation frame: it moves back by that.
    """

    transmitters: tuple[str, ...]
    gain: NDArray[np.float64]


@dataclass(frozen=True)
class PlacementAccuracy:
    """Predicted covariances, m^2, shape (2, 2), in the formation frame: at the end of each leg, and in the slot."""

    leg_ends: tuple[NDArray[np.float64], ...]
    slot: NDArray[np.float64]
    worst_axis_3sigma_m: float
    trim: Trim | None


def noise_of(problem: RelayProblem) -> BearingNoise:
    """Return what the problem says about the sensor and the first location."""
    return BearingNoise(problem.bearing_sigma_rad, problem.samples, problem.start_sigma_m, problem.heading_referenced)


def relay_accuracy(problem: RelayProblem, plan: RelayPlan) -> dict[str, PlacementAccuracy]:
    """Return the predicted accuracy of every placement of the plan, by receiver.

    With `problem.map_trim` each placement includes its trim leg. Raises InfeasiblePlanError when a stop reference does
    not tell the end of its leg.
    """
    names = [*problem.transmitters, *(route.receiver for route in plan.routes)]
    number = {name: k for k, name in enumerate(names)}
    places = [*problem.transmitters.values(), *(route.target for route in plan.routes)]
    errors = RelayErrors(np.array(places), noise_of(problem))
    accuracy: dict[str, PlacementAccuracy] = {}
    for route in plan.routes:
        error = errors.at_start()
        ends: list[NDArray[np.float64]] = []
        for leg in route.legs:
            reference = np.array([number[name] for name in leg.stop_reference])
            stop = errors.stop(error, LegLine(number[leg.guide], leg.start, leg.end), reference)
            if stop is None:
                blind = Obstruction(route.receiver, route.slot, f"{leg.stop_reference} does not tell the end of a leg")
                raise InfeasiblePlanError((blind,), "Choose another stop reference.")
            error = stop.error
            ends.append(error.own)
        trim: Trim | None = None
        if problem.map_trim and route.legs:
            error, trim = _trimmed(errors, error, route.target, route.transmitters, number)
        errors.place(number[route.receiver], error)
        accuracy[route.receiver] = PlacementAccuracy(tuple(ends), error.own, error.worst_axis_3sigma_m, trim)
    return accuracy


def _trimmed(
    errors: RelayErrors, error: PositionError, at: complex, transmitters: tuple[str, ...], number: dict[str, int]
) -> tuple[PositionError, Trim]:
    names = tuple(sorted(transmitters, key=lambda name: number[name]))
    trimmed, gain = errors.trim(error, at, np.array([number[name] for name in names]))
    return trimmed, Trim(names, gain)
