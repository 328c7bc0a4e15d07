"""Who stands: the transmitters whose places can be trusted, by name, formation frame, m."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

STANDING_SIGMA_M: Final = 0.1
"""No transmitter is known to hover about a better place than this; how it sways about it is another matter."""


@dataclass
class Standing:
    """The transmitters there from the start, at their given places, and every receiver PLACED since."""

    given: Mapping[str, complex]
    places: dict[str, complex] = field(init=False)
    sigma_m: dict[str, float] = field(init=False)
    """How well each place is known."""

    def __post_init__(self) -> None:
        self.places = dict(self.given)
        self.sigma_m = dict.fromkeys(self.given, STANDING_SIGMA_M)

    def hold(self, names: Collection[str]) -> bool:
        """Return whether all of these stand."""
        return self.places.keys() >= set(names)

    def join(self, name: str, place: complex, covariance: NDArray[np.float64]) -> None:
        """Let a receiver stand where bearings put it: there the next ones will find their transmitter."""
        self.places[name] = place
        self.sigma_m[name] = math.hypot(worst_sigma_m(covariance), STANDING_SIGMA_M)

    def lose(self, name: str) -> None:
        """Trust a transmitter no longer to stand where it did."""
        self.places.pop(name, None)
        self.sigma_m.pop(name, None)

    def restore(self, name: str) -> None:
        """Take a transmitter there from the start to stand at its given place again."""
        self.places[name] = self.given[name]
        self.sigma_m[name] = STANDING_SIGMA_M


def worst_sigma_m(covariance: NDArray[np.float64]) -> float:
    """Return the standard deviation along the worst axis of a covariance, m."""
    return math.sqrt(float(np.linalg.eigvalsh(covariance)[-1]))


def sigma_towards_m(way: complex, covariance: NDArray[np.float64]) -> float:
    """Return the standard deviation along a way, m; along the worst axis where there is none."""
    if not way:
        return worst_sigma_m(covariance)
    along = np.array([way.real, way.imag]) / abs(way)
    return math.sqrt(float(along @ covariance @ along))
