"""The error of a route flown without linearisation, by a fixed set of samples.

Where a leg begins so near its guide that the guide stands in the error's ellipse, no linear model holds. Each sample is
one draw of everything the route depends on; its legs are intersected exactly with the circles their stop angles mean.
What the samples say is handed back as a covariance and, by linear regression on the stations the route uses, as the
covariances with all others, so the relay's bookkeeping goes on as before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from planner.accuracy import LegLine, PositionError, Reals, RelayErrors
from planner.routes import Points

SAMPLES = 1024
_MOST_LOST = 0.1


def sampled_error(
    errors: RelayErrors, legs: Sequence[LegLine], references: Sequence[tuple[int, int]]
) -> PositionError | None:
    """Return the error at the end of the legs, flown one after the other from a located start.

    A sample whose angle never comes is lost: the flight would be held by its limits. The error is that of the others,
    None when more than a tenth is lost.
    """
    pairs = list(zip(legs, references, strict=True))
    used = np.array(sorted({station for leg, pair in pairs for station in (leg.guide, *pair)}))
    joint = errors.among(used).reshape(2 * used.size, 2 * used.size)
    drawn = _normal(2 * used.size + 2 + 2 * len(legs))
    moved = _root(joint) @ drawn[: 2 * used.size]
    real = dict(zip(used.tolist(), errors.stations[used, None] + moved[0::2] + 1j * moved[1::2], strict=True))
    off, found = _flown(errors, pairs, real, drawn[2 * used.size :])
    if np.mean(found) < 1.0 - _MOST_LOST:
        return None
    off, moved = off[found], moved[:, found]
    missed = np.stack([off.real, off.imag]) - np.array([[off.real.mean()], [off.imag.mean()]])
    by_station = missed @ moved.T / off.size @ np.linalg.pinv(joint, hermitian=True)
    shared = np.tensordot(by_station.reshape(2, used.size, 2), errors.covariance[used], axes=2)
    return PositionError(missed @ missed.T / off.size, shared)


def _flown(
    errors: RelayErrors,
    pairs: Sequence[tuple[LegLine, tuple[int, int]]],
    real: dict[int, Points],
    drawn: Reals,
) -> tuple[Points, NDArray[np.bool_]]:
    """Return how far off each sample ends, m, and whether it arrives at all.

    `real` is where the stations of each sample stand; `drawn`, shape (2 + 2 legs, samples), is standard normal.
    """
    noise, sigma_rad = errors.noise, math.sqrt(errors.noise.bearing_variance)
    place = pairs[0][0].begin + noise.start_sigma_m * (drawn[0] + 1j * drawn[1])
    found = np.ones(SAMPLES, dtype=np.bool_)
    for (leg, (first, second)), on_line, on_stop in zip(pairs, drawn[2::2], drawn[3::2], strict=True):
        guide, planned = real[leg.guide], leg.end - errors.stations[leg.guide]
        if noise.heading_referenced:
            direction = planned / abs(planned) * np.exp(1j * sigma_rad * on_line)
        else:
            direction = (place - guide) / np.abs(place - guide)
        told = np.angle((errors.stations[second] - leg.end) / (errors.stations[first] - leg.end))
        angle_rad = told + math.sqrt(2.0) * sigma_rad * on_stop
        distance_m = _crossing(direction, real[first] - guide, real[second] - guide, angle_rad, abs(planned))
        found &= np.isfinite(distance_m)
        place = np.where(found, guide + direction * np.where(found, distance_m, 0.0), leg.end)
    return place - pairs[-1][0].end, found


def _crossing(direction: Points, first: Points, second: Points, angle_rad: Reals, planned_m: float) -> Reals:
    """Return how far from the guide, m, the angle between two points is seen along a ray; infinity where it never is.

    Of two places the nearer to the planned distance. Points are relative to the guide.
    """
    turn = np.exp(-1j * angle_rad)
    a = turn.imag
    b = -np.imag(turn * (direction * first.conj() + direction.conj() * second))
    c = np.imag(turn * second * first.conj())
    square = b * b - 4.0 * a * c
    q = -(b + np.copysign(np.sqrt(np.maximum(square, 0.0)), b)) / 2.0
    best = np.full(direction.shape, np.inf)
    for top, bottom in ((q, a), (c, q)):
        told = (square >= 0.0) & (bottom != 0.0)
        distance_m = top / np.where(told, bottom, 1.0)
        x = distance_m * direction
        told &= (distance_m > 0.0) & (np.real(turn * (second - x) * (first - x).conj()) > 0.0)
        best = np.where(told & (np.abs(distance_m - planned_m) < np.abs(best - planned_m)), distance_m, best)
    return best


@cache
def _normal(dimensions: int) -> Reals:
    """Return standard normal samples, shape (dimensions, samples), whose mean and covariance are exact."""
    half = np.random.default_rng(0).standard_normal((dimensions, SAMPLES // 2))
    samples = np.concatenate([half, -half], axis=1)
    exact: Reals = np.linalg.solve(np.linalg.cholesky(samples @ samples.T / SAMPLES), samples)
    exact.flags.writeable = False
    return exact


def _root(covariance: Reals) -> Reals:
    values, axes = np.linalg.eigh(covariance)
    return np.asarray(axes * np.sqrt(np.maximum(values, 0.0)))
