"""Assignment of receivers to slots: the Hungarian method over the routes that can be flown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Lengths = NDArray[np.float64]
Mask = NDArray[np.bool_]


def hungarian(length_m: Lengths, feasible: Mask) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return (column of each row, rows left without a feasible column).

    The pairing first serves as many rows as can be served, then minimises the total length. `length_m` and `feasible`
    have one shape (rows, columns), rows <= columns; entries of infeasible pairs are ignored.
    """
    longest = float(np.max(length_m, where=feasible, initial=0.0))
    forbidden = (longest + 1.0) * (length_m.shape[0] + 1)
    rows, columns = linear_sum_assignment(np.where(feasible, length_m, forbidden))
    return columns, rows[~feasible[rows, columns]]


def straight_line_bound(starts: NDArray[np.complex128], slots: NDArray[np.complex128]) -> float:
    """Return the least total length any plan could have, m: the Hungarian assignment of straight distances."""
    distance_m = np.abs(starts[:, None] - slots[None, :])
    rows, columns = linear_sum_assignment(distance_m)
    return float(distance_m[rows, columns].sum())
