"""What one receiver measures: the directions it sees transmitters in, at known places, each with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from planner.angles import wrap_all
from planner.dilution import Complexes, Floats, Information
from planner.errors import PositioningError

_LEAST_SIGMA_RAD = 1e-9
"""A standard deviation below this, of rounding alone, is taken as this."""


@dataclass(frozen=True, eq=False)
class Expected:
    """Where the receiver was expected before anything was seen, m, and the information of that, 1/m^2."""

    position: complex
    information: Information

    def misfit(self, position: complex) -> float:
        """Return how far a position is from there, in standard deviations, squared."""
        return float(self.information.form(position - self.position))


@dataclass(frozen=True, eq=False)
class Sightings:
    """The directions (n,), rad, to transmitters at known places, and how well each is known.

    What was `expected` counts like what is seen.
    """

    names: tuple[str, ...]
    directions: Floats
    places: Complexes
    sigmas: Floats
    heading_known: bool
    expected: Expected | None = None

    def __str__(self) -> str:
        return ", ".join(self.names) or "none"

    @property
    def unknowns(self) -> int:
        """How many directions fix the receiver."""
        return 2 if self.heading_known else 3

    @property
    def fewest(self) -> int:
        """How many directions are needed: two are enough where a receiver was expected."""
        return self.unknowns if self.expected is None else 2

    @property
    def redundant(self) -> bool:
        """Whether one direction can be rejected and the rest still be checked: by each other, not by expectation."""
        return len(self.names) >= self.unknowns + 2

    def reach_m(self, position: complex) -> float:
        """Return the distance to the farthest transmitter."""
        return float(np.abs(self.places - position).max())

    def turned(self, position: complex | Complexes) -> Floats:
        """Return measured minus expected directions from each position, shape (positions..., n), rad."""
        expected = np.angle(self.places - np.asarray(position)[..., None])
        return wrap_all(self.directions - expected)


def take_sightings(
    directions_rad: Mapping[str, float],
    transmitters: Mapping[str, complex],
    sigma_rad: float | Mapping[str, float],
    *,
    heading_known: bool,
    expected: Expected | None = None,
) -> Sightings:
    """Return the sightings of the named transmitters; PositioningError when they cannot fix any receiver."""
    names = tuple(directions_rad)
    unplaced = [name for name in names if name not in transmitters]
    if unplaced:
        raise PositioningError(f"no place is known for transmitter {', '.join(unplaced)}: give it or leave it out")
    sigmas = sigma_rad if isinstance(sigma_rad, Mapping) else dict.fromkeys(names, sigma_rad)
    sigmas = {name: sigmas.get(name, math.nan) for name in names}
    for name in names:
        if not (math.isfinite(directions_rad[name]) and 0.0 <= sigmas[name] < math.inf):
            raise PositioningError(
                f"direction to {name} is {directions_rad[name]} with sigma {sigmas[name]} rad: both must be finite, "
                "and sigma not negative"
            )
    seen = Sightings(
        names,
        np.array([directions_rad[name] for name in names], dtype=np.float64),
        np.array([transmitters[name] for name in names], dtype=np.complex128),
        np.maximum(np.array([sigmas[name] for name in names], dtype=np.float64), _LEAST_SIGMA_RAD),
        heading_known,
        expected,
    )
    if len(names) < seen.fewest:
        needs = "three transmitters while the heading is unknown" if seen.fewest > 2 else "two transmitters"
        raise PositioningError(f"locating takes {needs}, only {seen} heard: switch on another")
    return seen
