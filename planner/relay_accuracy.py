"""How accurately a given relay plan, of whatever method, places its receivers; and the trim leg that follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.accuracy import BearingNoise, LegLine, RelayErrors
from planner.landing import Landing, land
from planner.plan import Leg, Route
from planner.relay import RelayProblem
from planner.trimming import trim

_NO_LEG_RATIO = 1e-9
"""A leg shorter than this part of its route changes nothing."""


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


def relay_accuracy(problem: RelayProblem, routes: Sequence[Route]) -> dict[str, PlacementAccuracy]:
    """Return the predicted accuracy of the placements, by receiver; the routes come in the order they are flown.

    With `problem.map_trim` each placement includes its trim leg. A receiver is left out when a stop reference does not
    tell the end of its leg, when its predicted error is as large as the whole figure, so that no linear model means
    anything, and when it depends on another that is left out.
    """
    places = dict(problem.transmitters) | {route.receiver: route.target for route in routes}
    number = {name: k for k, name in enumerate(places)}
    stations = np.array(list(places.values()))
    figure_m = float(np.abs(stations - stations[0]).max())
    errors = RelayErrors(stations, noise_of(problem))
    accuracy: dict[str, PlacementAccuracy] = {}
    for route in routes:
        if not all(name in problem.transmitters or name in accuracy for name in route.transmitters):
            continue
        landing = _landing(errors, route, number)
        if landing is None or not landing.error.worst_axis_3sigma_m < figure_m:
            continue
        error, trimmed = landing.error, None
        if problem.map_trim and landing.stops:
            on_air = landing.transmitters
            error, gain = trim(errors, error, route.target, np.array(on_air))
            trimmed = Trim(tuple(list(places)[station] for station in on_air), gain)
        errors.place(number[route.receiver], error)
        accuracy[route.receiver] = PlacementAccuracy(
            _leg_ends(errors, route, landing), error.own, error.worst_axis_3sigma_m, trimmed
        )
    return accuracy


def _landing(errors: RelayErrors, route: Route, number: Mapping[str, int]) -> Landing | None:
    legs = [leg for leg in route.legs if _is_flown(leg, route)]
    return land(
        errors,
        [LegLine(number[leg.guide], leg.start, leg.end) for leg in legs],
        [np.array([number[name] for name in leg.stop_reference]) for leg in legs],
    )


def _leg_ends(errors: RelayErrors, route: Route, landing: Landing) -> tuple[NDArray[np.float64], ...]:
    """Return the covariance at the end of every leg, those of no length included."""
    stops, here, ends = iter(landing.stops), errors.at_start(), []
    for leg in route.legs:
        here = next(stops).error if _is_flown(leg, route) else here
        ends.append(here.own)
    return tuple(ends)


def _is_flown(leg: Leg, route: Route) -> bool:
    return leg.length_m > _NO_LEG_RATIO * route.length_m
