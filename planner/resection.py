"""Locating one receiver from the directions it sees the transmitters in, with its heading known or not.

Closed forms give a position for each pair of transmitters (crossing lines of bearing) or each triple (two circles);
they seed a robust least-squares fit to all directions.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from planner.dilution import Complexes, Floats, Information
from planner.errors import PositioningError
from planner.robust_fit import Fix, fit_sightings
from planner.sightings import Expected, Sightings, take_sightings
from planner.two_circle import two_circle

_LEAST_SINE = 1e-9
"""Lines of bearing that cross at a smaller angle are parallel."""
_MOST_TRIPLES = 2000
"""Of more triples, so many are taken evenly."""


def locate_by_bearings(
    directions_rad: Mapping[str, float],
    transmitters: Mapping[str, complex],
    sigma_rad: float | Mapping[str, float],
    prior: complex | None = None,
) -> Fix:
    """Return where a receiver is that sees the transmitters in these polar directions of the formation frame, rad.

    Takes two transmitters or more; `transmitters` gives their places, m, and may hold others. `sigma_rad` is the
    standard deviation of a direction, for all or each by name. `prior` is a rough position, one more seed. From four
    transmitters on, those that disagree with the rest (multipath) are rejected.

    Raises PositioningError, naming the transmitters and the way out, when there are fewer than two, when their lines of
    bearing meet behind the receiver or at a transmitter, contradict each other, or are so nearly parallel that the
    covariance would not hold over three standard deviations.
    """
    seen = take_sightings(directions_rad, transmitters, sigma_rad, heading_known=True)
    seeds = _crossings(seen)
    return fit_sightings(seen, *_with_prior(seen, seeds, np.zeros(seeds.shape), prior))


def locate_by_subtended_angles(
    directions_rad: Mapping[str, float],
    transmitters: Mapping[str, complex],
    sigma_rad: float | Mapping[str, float],
    prior: complex | None = None,
    prior_covariance: Floats | None = None,
) -> Fix:
    """Return where a receiver of unknown heading is: only the differences of the polar directions count, rad.

    As `locate_by_bearings`, but takes three transmitters or more and rejects outliers from five on. Directions run
    counter-clockwise from any axis of the receiver's own.

    With the covariance of the prior, m^2, shape (2, 2), the fix is the maximum a posteriori of both, and the covariance
    is of that. Two transmitters do then; outliers are still rejected from five on.

    Raises PositioningError, naming the transmitters and the way out, when there are fewer, when the receiver is on the
    circle (or line) through them or so near it that the covariance would not hold over three standard deviations, and
    when the angles contradict each other or the prior, whose covariance must be positive definite.
    """
    expected = None
    if prior is not None and prior_covariance is not None:
        if not (np.isfinite(prior_covariance).all() and np.linalg.eigvalsh(prior_covariance)[0] > 0.0):
            raise PositioningError("the covariance of the prior is none: nothing is known exactly, or not at all")
        expected = Expected(prior, Information.of(prior_covariance))
    seen = take_sightings(directions_rad, transmitters, sigma_rad, heading_known=False, expected=expected)
    return fit_sightings(seen, *_with_prior(seen, *_resections(seen), prior))


def _crossings(seen: Sightings) -> Complexes:
    """Return where the lines of bearing cross, pair by pair; parallel pairs are left out."""
    i, j = np.triu_indices(len(seen.names), 1)
    towards = np.exp(1j * seen.directions)
    sine = np.imag(np.conj(towards[j]) * towards[i])
    crossing = np.abs(sine) > _LEAST_SINE
    i, j, sine = i[crossing], j[crossing], sine[crossing]
    distance = np.imag(np.conj(towards[j]) * (seen.places[i] - seen.places[j])) / sine
    return np.asarray(seen.places[i] - distance * towards[i])


def _resections(seen: Sightings) -> tuple[Complexes, Floats]:
    """Return the two-circle positions and headings, triple by triple; degenerate ones are left out."""
    if len(seen.names) < 3:
        return np.empty(0, dtype=np.complex128), np.empty(0)
    triples = np.array(list(itertools.combinations(range(len(seen.names)), 3)))
    i, j, k = triples[:: len(triples) // _MOST_TRIPLES + 1].T
    direction, place = seen.directions, seen.places
    fixes = two_circle(direction[j] - direction[i], direction[k] - direction[i], place[i], place[j], place[k])
    positions = fixes.position[fixes.valid]
    headings = direction[i][fixes.valid] - np.angle(place[i][fixes.valid] - positions)
    return positions, headings


def _with_prior(
    seen: Sightings, positions: Complexes, headings: Floats, prior: complex | None
) -> tuple[Complexes, Floats]:
    """Add the prior to the seeds, if any, with the heading each of the transmitters would tell from there."""
    if prior is None or (not positions.size and seen.expected is None):
        return positions, headings
    told = np.zeros(1) if seen.heading_known else seen.turned(prior)
    return np.append(positions, np.full(told.shape, prior)), np.append(headings, told)
