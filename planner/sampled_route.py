"""The error of a route flown without linearisation, by a fixed set of samples.

Where a leg begins so near its guide that the guide stands in the error's ellipse, no linear model holds. Each sample is
one draw of everything the route depends on; its legs are intersected exactly with the circles their stop angles mean.
What the samples say is handed back as a covariance and, by linear regression on the stations the route uses, as the
covariances with all others, so the relay's bookkeeping goes on as before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from planner.accuracy import Indices, LegLine, PositionError, Reals, RelayErrors
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
    used = np.array(
        sorted({station for leg, pair in zip(legs, references, strict=True) for station in (leg.guide, *pair)})
    )
    noise, joint = errors.noise, errors.among(used).reshape(2 * used.size, 2 * used.size)
    normal = iter(_normal(2 * used.size + 2 + 2 * len(legs)).T)
    moved = _root(joint) @ np.stack([next(normal) for _ in range(2 * used.size)])
    real = dict(zip(used.tolist(), errors.stations[used, None] + moved[0::2] + 1j * moved[1::2], strict=True))
    place = legs[0].begin + noise.start_sigma_m * (next(normal) + 1j * next(normal))
    found = np.ones(SAMPLES, dtype=np.bool_)
    sigma_rad = math.sqrt(noise.bearing_variance)
    for leg, (first, second) in zip(legs, references, strict=True):
        guide, planned = real[leg.guide], leg.end - errors.stations[leg.guide]
        if noise.heading_referenced:
            direction = planned / abs(planned) * np.exp(1j * sigma_rad * next(normal))
        else:
            direction = (place - guide) / np.abs(place - guide)
        told = np.angle((errors.stations[second] - leg.end) / (errors.stations[first] - leg.end))
        angle_rad = told + math.sqrt(2.0) * sigma_rad * next(normal)
        distance_m = _crossing(direction, real[first] - guide, real[second] - guide, angle_rad, abs(planned))
        found &= np.isfinite(distance_m)
        place = np.where(found, guide + direction * np.where(found, distance_m, 0.0), leg.end)
    if np.mean(found) < 1.0 - _MOST_LOST:
        return None
    off = (place - legs[-1].end)[found]
    missed, moved = np.stack([off.real, off.imag]), moved[:, found]
    missed = missed - missed.mean(axis=1, keepdims=True)
    by_station = missed @ moved.T / off.size @ np.linalg.pinv(joint, hermitian=True)
    shared = np.tensordot(by_station.reshape(2, used.size, 2), errors.covariance[used], axes=2)
    return PositionError(missed @ missed.T / off.size, shared)


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


def _normal(dimensions: int) -> Reals:
    """Return standard normal samples, shape (samples, dimensions), whose mean and covariance are exact."""
    half = np.random.default_rng(0).standard_normal((SAMPLES // 2, dimensions))
    samples = np.concatenate([half, -half])
    return np.asarray(np.linalg.solve(np.linalg.cholesky(samples.T @ samples / SAMPLES), samples.T).T)


def _root(covariance: Indices | Reals) -> Reals:
    values, axes = np.linalg.eigh(covariance)
    return np.asarray(axes * np.sqrt(np.maximum(values, 0.0)))
