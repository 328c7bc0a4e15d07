"""Where a route leaves its receiver: each leg stopped in turn, and the error in the slot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

from planner.accuracy import Indices, LegLine, PositionError, RelayErrors
from planner.sampled_route import sampled_error
from planner.stop_accuracy import Stop, best_stop


@dataclass(frozen=True)
class Landing:
    """The stops of a route, one for each leg flown, and the error the receiver is left with in its slot."""

    stops: tuple[Stop, ...]
    error: PositionError

    @property
    def dependable(self) -> bool:
        """Whether a linear model holds on every leg."""
        return all(stop.dependable for stop in self.stops)

    @property
    def transmitters(self) -> list[int]:
        """Every station the route needs on the air, in order."""
        return sorted({station for stop in self.stops for station in (stop.leg.guide, *stop.reference)})


def land(errors: RelayErrors, legs: Sequence[LegLine], candidates: Sequence[Indices]) -> Landing | None:
    """Return how the legs are best stopped, each by a pair of its candidates; None when none tells a leg's end.

    Where the linear model does not hold the error is that of the route flown by samples, if enough of them arrive.
    """
    error = errors.at_start()
    stops: list[Stop] = []
    for leg, following, stations in zip_longest(legs, legs[1:], candidates):
        stop = best_stop(errors, error, leg, stations, following)
        if stop is None:
            return None
        stops.append(stop)
        error = stop.error
    landing = Landing(tuple(stops), error)
    if landing.dependable:
        return landing
    sampled = sampled_error(errors, legs, [stop.reference for stop in stops])
    return landing if sampled is None else Landing(landing.stops, sampled)
