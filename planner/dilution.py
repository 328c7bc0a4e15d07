"""How accurately bearings can fix a position: the information they carry, and its geometric dilution.

A step dx changes the polar direction from x to a transmitter at q by g . dx, with the gradient g = -i / conj(q - x),
1/m. Bearings with weights w (1 / sigma^2, 1/rad^2) together carry the information matrix sum of w g g^T, kept here as
the two numbers

    s = sum of w |g|^2        t = sum of w g^2 (complex)

since its eigenvalues are (s + |t|) / 2 and (s - |t|) / 2. An unknown heading turns all directions alike and takes
away the weighted mean of the gradients.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

DILUTION_CAP_M_PER_RAD = 1e9
"""The dilution where the bearings do not fix the position at all."""

COINCIDENT_RATIO = 1e-9
"""Nearer to a transmitter than this part of the distance to the farthest one, a receiver stands at it."""

_LEAST_SPREAD = 1e-13
"""The information is singular when its determinant is less than this part of its squared trace."""

Complexes = NDArray[np.complex128]
Floats = NDArray[np.float64]
Scalar = TypeVar("Scalar", np.float64, np.complex128)


@dataclass(frozen=True, eq=False)
class Information:
    """Symmetric 2x2 matrices, 1/m^2, as `s` (real) and `t` (complex) of one shape."""

    s: Floats
    t: Complexes

    @classmethod
    def of(cls, covariance: Floats) -> Information:
        """Return the information of a place known with a covariance, m^2, shape (2, 2)."""
        (a, b), (_, d) = np.linalg.inv(covariance)
        return cls(np.asarray(a + d), np.asarray(a - d + 2j * b))

    def __add__(self, other: Information) -> Information:
        return Information(self.s + other.s, self.t + other.t)

    @property
    def determinant(self) -> Floats:
        """Four times the determinant, 1/m^4."""
        return np.asarray(self.s**2 - np.abs(self.t) ** 2)

    @property
    def singular(self) -> NDArray[np.bool_]:
        """Where the position is not fixed."""
        return np.asarray(~(self.determinant > _LEAST_SPREAD * self.s**2))

    def times(self, vector: complex) -> complex:
        """Return (matrix) vector, of one matrix."""
        return complex(self.s * vector + self.t * vector.conjugate()) / 2.0

    def solve(self, right: ArrayLike) -> Complexes:
        """Return the vectors x with (matrix) x = right; the matrices must not be singular."""
        vector = np.asarray(right, dtype=np.complex128)
        return np.asarray(2.0 * (self.s * vector - self.t * np.conj(vector)) / self.determinant)

    def form(self, vector: complex) -> Floats:
        """Return vector^T (matrix) vector: the squared length of a vector, m, in standard deviations."""
        return np.asarray(0.5 * (self.s * abs(vector) ** 2 + np.real(self.t * vector.conjugate() ** 2)))

    @property
    def axes(self) -> tuple[Complexes, Complexes]:
        """The semi-axes of the error ellipse of one standard deviation, as vectors, m: the longer and the shorter."""
        size, along = np.abs(self.t), np.exp(0.5j * np.angle(self.t))
        return 1j * along * np.sqrt(2.0 / (self.s - size)), along * np.sqrt(2.0 / (self.s + size))

    @property
    def inverse(self) -> Floats:
        """The covariance, shape (..., 2, 2), m^2."""
        columns = np.stack([self.solve(1.0), self.solve(1.0j)], axis=-1)
        return np.stack([columns.real, columns.imag], axis=-2)


def bearing_gradients(position: ArrayLike, transmitters: ArrayLike) -> Complexes:
    """Return the gradient of each direction position -> transmitter, 1/m, shape (positions..., transmitters).

    At a transmitter, where the direction is undefined, its gradient is 0.
    """
    away = np.asarray(transmitters, dtype=np.complex128) - np.asarray(position, dtype=np.complex128)[..., None]
    distance_m = np.abs(away)
    nowhere = distance_m <= COINCIDENT_RATIO * distance_m.max(axis=-1, keepdims=True)
    return np.where(nowhere, 0.0, -1j / np.conj(np.where(nowhere, 1.0, away)))


def centred(values: NDArray[Scalar], weights: Floats) -> NDArray[Scalar]:
    """Return the values less their weighted mean over the last axis: what is left of them when the heading is free."""
    return np.asarray(values - (values @ weights / weights.sum())[..., None])


def information(gradients: Complexes, weights: Floats) -> Information:
    """Return the information of bearings with these gradients (..., n), 1/m, and weights (n,)."""
    return Information(np.abs(gradients) ** 2 @ weights, gradients**2 @ weights)


def dilution(position: ArrayLike, transmitters: ArrayLike, heading_referenced: bool) -> Floats:
    """Return the geometric dilution (GDOP) of bearings to transmitters: m of position error per rad of bearing error.

    It is sqrt(trace(covariance)) for a standard deviation of 1 rad on each bearing, for each of the positions
    (any shape; the result has the same). `transmitters` are points, shape (n,). With `heading_referenced` False only
    differences of bearings count. Where the position is not fixed - too few transmitters, all in line with it or on one
    circle with it, or at one of them to a millionth of the field - it is DILUTION_CAP_M_PER_RAD, and nowhere greater.
    """
    gradients = bearing_gradients(position, transmitters)
    at_transmitter = (gradients == 0.0).any(axis=-1)
    weights = np.ones(gradients.shape[-1])
    matrix = information(gradients if heading_referenced else centred(gradients, weights), weights)
    unfixed = matrix.singular | at_transmitter
    gdop = 2.0 * np.sqrt(matrix.s / np.where(unfixed, 1.0, matrix.determinant))
    return np.where(unfixed, DILUTION_CAP_M_PER_RAD, np.minimum(gdop, DILUTION_CAP_M_PER_RAD))
