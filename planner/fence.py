"""The fence: a polygon no leg may leave."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def leaves_fence(begin: ArrayLike, end: ArrayLike, corners: tuple[complex, ...]) -> NDArray[np.bool_]:
    """Return where the segment begin-end leaves the polygon; begin and end broadcast, its edges count as inside."""
    p, q = np.broadcast_arrays(np.asarray(begin, dtype=np.complex128), np.asarray(end, dtype=np.complex128))
    crosses = np.zeros(p.shape, dtype=np.bool_)
    inside = np.zeros(p.shape, dtype=np.bool_)
    on_edge = np.zeros(p.shape, dtype=np.bool_)
    middle = (p + q) / 2.0
    for one, other in zip(corners, (*corners[1:], corners[0]), strict=True):
        edge = other - one
        sides = _cross(edge, p - one) * _cross(edge, q - one)
        crosses |= (sides < 0.0) & (_cross(q - p, one - p) * _cross(q - p, other - p) < 0.0)
        above, below = one.imag > middle.imag, other.imag > middle.imag
        meets_at = one.real + edge.real * (middle.imag - one.imag) / (edge.imag or 1.0)
        inside ^= (above != below) & (middle.real < meets_at)
        on_edge |= (_cross(edge, middle - one) == 0.0) & (np.real((middle - one) * np.conj(middle - other)) <= 0.0)
    return crosses | ~(inside | on_edge)


def _cross(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    return np.imag(np.conj(first) * np.asarray(second))
