"""Least squares over the directions one receiver sees several transmitters in, kept from the ones that lie.

Of the seeds, the one most transmitters agree with starts a Gauss-Newton fit; then those that disagree with the fit are
left out and those that agree taken in until that changes no more. With an unknown heading all directions are turned
alike: model and residuals are taken about their weighted mean, which is the same as estimating the heading as well.
Where the receiver was expected, with a covariance, that is one more thing measured.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.angles import wrap_all
from planner.dilution import COINCIDENT_RATIO, Complexes, Floats, Information, bearing_gradients, centred, information
from planner.errors import PositioningError
from planner.sightings import Sightings

_GATE = 4.0
"""A direction this many standard deviations off is an outlier."""
_STEADY = 2.0
"""A covariance counts only if its longer axis grows or shrinks by less than this within three standard deviations."""
_MOST_STEPS = 50
_CONVERGED = 1e-13
"""A step this small against the distance to the farthest transmitter ends the least squares."""
_RIVALS = 6
"""So many different sets of agreeing transmitters are followed up."""
_EVIDENCE = 9.0
"""A rival fit with less than this more of squared normalised misfit is as good."""
_APART = 5.0
"""Rival fits so many standard deviations apart are two positions, not one."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Fix:
    """A located receiver, formation frame: position, m, and its predicted covariance, m^2, shape (2, 2), axes x, y.

    `residual_rad` is the root mean square of the residuals of the directions to the transmitters in `used`;
    those in `rejected` disagree with them.
    """

    position: complex
    covariance: Floats
    residual_rad: float
    used: tuple[str, ...]
    rejected: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Solution:
    """Where the least squares over the `used` directions settled; `cost` counts an outlier as one at the gate."""

    position: complex
    used: Mask
    residuals: Floats
    matrix: Information
    cost: float


def fit_sightings(seen: Sightings, positions: Complexes, headings: Floats) -> Fix:
    """Return the least-squares fix that most directions agree with, from seeds: positions and headings, shape (m,).

    Raises PositioningError when the directions leave the position open or contradict each other.
    """
    if not positions.size:
        raise _unfixed(seen)
    turned = wrap_all(seen.turned(positions) - headings[:, None])
    misfit = (turned / seen.sigmas) ** 2
    best_first = np.argsort(np.minimum(misfit, _gate(seen)).sum(axis=-1), kind="stable")
    _, firsts = np.unique(misfit[best_first] <= _gate(seen), axis=0, return_index=True)

    solutions: list[_Solution] = []
    failure: PositioningError | None = None
    for seed in best_first[np.sort(firsts)[:_RIVALS]]:
        try:
            solutions.append(_settle(seen, complex(positions[seed]), turned[seed]))
        except PositioningError as error:
            failure = failure or error
        if solutions and solutions[0].cost < _GATE**2 - _EVIDENCE:
            break  # whoever leaves one out pays the gate for it: no rival can be as good
    if not solutions and failure is not None:
        raise failure
    best = min(solutions, key=lambda solution: solution.cost)
    _check(seen, best, solutions)
    return Fix(
        position=best.position,
        covariance=best.matrix.inverse,
        residual_rad=math.sqrt(best.residuals**2 @ best.used / best.used.sum()),
        used=tuple(itertools.compress(seen.names, best.used)),
        rejected=tuple(itertools.compress(seen.names, ~best.used)),
    )


def _settle(seen: Sightings, position: complex, turned: Floats) -> _Solution:
    """Return the solution a seed leads to: fit the directions that agree, until they stay the same."""
    used = (turned / seen.sigmas) ** 2 <= _gate(seen)
    _check_sight(seen, position, turned, used)
    for _ in seen.names:
        if used.sum() < seen.fewest:
            raise _contradiction(seen, f"only {int(used.sum())} agree")
        position = _least_squares(seen, position, used)
        before, used = used, _agreeing(seen, position, used)
        if (used == before).all():
            break
    else:
        raise _contradiction(seen, "those that agree keep changing")
    residuals, _, matrix = _linear_model(seen, position, used)
    _check_sight(seen, position, residuals, used)
    cost = float(np.minimum((residuals / seen.sigmas) ** 2, _gate(seen)).sum()) + _surprise(seen, position)
    return _Solution(position, used, residuals, matrix, cost)


def _gate(seen: Sightings) -> float:
    """Return the squared normalised misfit of an outlier; no direction is one where none could be spared."""
    return _GATE**2 if seen.redundant else math.inf


def _information(seen: Sightings, position: complex | Complexes, used: Mask) -> tuple[Complexes, Information]:
    """Return gradients and information of the used directions, about their mean if the heading is unknown."""
    weights = seen.sigmas**-2.0 * used
    gradients = bearing_gradients(position, seen.places)
    if not seen.heading_known:
        gradients = centred(gradients, weights)
    matrix = information(gradients, weights)
    return gradients, matrix if seen.expected is None else matrix + seen.expected.information


def _surprise(seen: Sightings, position: complex) -> float:
    """Return the squared normalised misfit of a position to where the receiver was expected."""
    return 0.0 if seen.expected is None else seen.expected.misfit(position)


def _linear_model(seen: Sightings, position: complex, used: Mask) -> tuple[Floats, Complexes, Information]:
    """Return residuals, gradients and information, about their mean over the used ones if the heading is unknown."""
    weights = seen.sigmas**-2.0 * used
    residuals = seen.turned(position)
    if not seen.heading_known:
        heading = np.angle(np.exp(1j * residuals) @ weights)
        residuals = centred(wrap_all(residuals - heading), weights)
    return residuals, *_information(seen, position, used)


def _least_squares(seen: Sightings, position: complex, used: Mask) -> complex:
    """Return the position of least weighted squared residuals, by Gauss-Newton steps halved until they improve it."""
    weights = seen.sigmas**-2.0 * used
    residuals, gradients, matrix = _linear_model(seen, position, used)
    for _ in range(_MOST_STEPS):
        if matrix.singular:
            raise _unfixed(seen)
        pull = complex((gradients * residuals) @ weights)
        if seen.expected is not None:
            pull += seen.expected.information.times(seen.expected.position - position)
        step = complex(matrix.solve(pull))
        cost = residuals**2 @ weights + _surprise(seen, position)
        while abs(step) > _CONVERGED * seen.reach_m(position):
            trial = _linear_model(seen, position + step, used)
            if trial[0] ** 2 @ weights + _surprise(seen, position + step) < cost:
                break
            step /= 2.0
        else:
            break
        position, (residuals, gradients, matrix) = position + step, trial
    return position


def _agreeing(seen: Sightings, position: complex, used: Mask) -> Mask:
    """Return which directions agree with the position the used ones fix, given what both leave open."""
    if not seen.redundant:
        return used
    residuals, gradients, matrix = _linear_model(seen, position, used)
    if matrix.singular:
        raise _unfixed(seen)
    variance = seen.sigmas**2 + np.real(np.conj(gradients) * matrix.solve(gradients))
    if not seen.heading_known:
        variance += 1.0 / (seen.sigmas[used] ** -2.0).sum()
    return np.asarray(residuals**2 <= _gate(seen) * variance)


def _check(seen: Sightings, best: _Solution, solutions: list[_Solution]) -> None:
    """Refuse the best solution when a rival is as good, when too few agree with it, or when it is not steady."""
    for rival in solutions:
        step = rival.position - best.position
        apart = min(best.matrix.form(step), rival.matrix.form(step))
        if rival.cost < best.cost + _EVIDENCE and apart > _APART**2:
            raise _contradiction(
                seen, f"{best.position:.6g} and {rival.position:.6g} fit as well, with different ones left out"
            )
    count = int(best.used.sum())
    spare = count - seen.unknowns
    misfit = (best.residuals / seen.sigmas) ** 2 @ best.used + _surprise(seen, best.position)
    measured_besides = 0 if seen.expected is None else 2
    rms_sigmas = math.sqrt(misfit / max(spare + measured_besides, 1))
    outvoted = seen.redundant and (spare < 1 or 2 * count <= len(seen.names))
    if outvoted or rms_sigmas > _GATE:
        raise _contradiction(seen, f"{count} agree, to {rms_sigmas:.1f} standard deviations")
    if not _steady(seen, best.position, best.used):
        raise _unfixed(seen)


def _steady(seen: Sightings, position: complex, used: Mask) -> bool:
    """Whether linear error propagation holds: the predicted error is much the same all over its own range."""
    here = _information(seen, position, used)[1]
    if here.singular:
        return False
    longer, shorter = (complex(axis) for axis in here.axes)
    ends = position + 3.0 * np.array([longer, -longer, shorter, -shorter], dtype=np.complex128)
    there = _information(seen, ends, used)[1]
    if there.singular.any():
        return False
    growth = np.abs(there.axes[0]) / abs(longer)
    return bool(growth.max() < _STEADY and growth.min() > 1.0 / _STEADY)


def _check_sight(seen: Sightings, position: complex, residuals: Floats, used: Mask) -> None:
    """Refuse a position at a transmitter, or from where a used transmitter would have to be seen behind."""
    distance_m = np.abs(seen.places - position)
    for name, near, behind in zip(
        seen.names,
        distance_m <= COINCIDENT_RATIO * distance_m.max(),
        used & (np.abs(residuals) >= math.pi / 2),
        strict=True,
    ):
        if near:
            raise PositioningError(f"the receiver stands at transmitter {name}, where no direction is defined")
        if behind:
            raise _contradiction(seen, f"{name} would lie behind the receiver")


def _contradiction(seen: Sightings, how: str) -> PositioningError:
    if seen.expected is None:
        what, suspect = "each other", "a wrong heading or a wrong place"
    else:
        what, suspect = "each other, or where the receiver was expected", "a wrong place or a start known less well"
    return PositioningError(
        f"the directions to {seen} contradict {what}: {how}; look for multipath, {suspect}, "
        "or switch on another transmitter"
    )


def _unfixed(seen: Sightings) -> PositioningError:
    if seen.heading_known:
        why = "the lines of bearing are parallel or nearly so"
        way_out = "use a transmitter off to the side, or average more samples"
    else:
        why = "the receiver is on the circle (or line) through them, or nearly so"
        way_out = "use a transmitter that is not on it, north-referenced bearings, or average more samples"
    return PositioningError(f"the directions to {seen} do not fix the receiver: {why}; {way_out}")
