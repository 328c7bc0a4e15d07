"""Angles on the circle: the one place where they wrap.

A point is a complex number in the formation frame, metres; its polar angle runs counter-clockwise seen from above,
as in the paper. A bearing (azimuth) runs clockwise from true north, so differences of bearings change sign.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Angles = NDArray[np.float64]


def wrap(angle_rad: float) -> float:
    """Return the angle brought into (-pi, pi], rad."""
    return math.pi - (math.pi - angle_rad) % math.tau


def direction(vector: complex) -> float:
    """Return the polar direction of a vector, rad in [-pi, pi] (`cmath.phase` overflows on the smallest numbers)."""
    return math.atan2(vector.imag, vector.real)


def wrap_all(angles_rad: ArrayLike) -> Angles:
    """Return every angle of an array brought into (-pi, pi], rad."""
    return np.pi - np.mod(np.pi - np.asarray(angles_rad, dtype=np.float64), np.pi * 2)


def subtended_angle(vertex: ArrayLike, first: ArrayLike, second: ArrayLike) -> Angles:
    """Return the signed angle at `vertex` from `first` to `second`, counter-clockwise, rad in (-pi, pi].

    With D, A, B it is the paper's alpha (eq. 7), signed: arg((B - D) / (A - D)).
    Arrays broadcast. The angle is meaningless where `vertex` coincides with either point.
    """
    at = np.asarray(vertex, dtype=np.complex128)
    to_first, to_second = np.asarray(first) - at, np.asarray(second) - at
    return wrap_all(np.angle(to_second * np.conj(to_first)))


def subtended_by_bearings(first_azimuth_rad: float, second_azimuth_rad: float) -> float:
    """Return the same signed angle from the two bearings one receiver measures, rad in (-pi, pi].

    Azimuth runs clockwise and the formation's polar angle counter-clockwise: the first minus the second.
    """
    return wrap(first_azimuth_rad - second_azimuth_rad)
