"""The trim leg: what a receiver standing in its slot still learns of its error, and how it moves back."""

from __future__ import annotations

import numpy as np

from planner.accuracy import Indices, PositionError, Reals, RelayErrors, bearing_gradient


def trim(errors: RelayErrors, error: PositionError, at: complex, transmitters: Indices) -> tuple[PositionError, Reals]:
    """Return the error after the maximum-a-posteriori trim leg, and the trim's gain, shape (2, t), m/rad.

    The receiver standing near `at` measures the bearings of the t transmitters once more, estimates its error with
    the predicted covariance as the prior, and moves back by the estimate: gain times the bearings' surplus
    (measured minus planned direction, rad, counter-clockwise). Without a north reference the gain is blind to
    what all bearings have in common. The variance never grows.
    """
    gradient = bearing_gradient(at, errors.stations[transmitters])
    own_moved = np.einsum("ajb,jb->aj", error.shared[:, transmitters], gradient)
    with_error = error.own @ gradient.T - own_moved
    moved = np.einsum("ia,iajb,jb->ij", gradient, errors.among(transmitters), gradient)
    crossed = gradient @ own_moved
    spread = gradient @ error.own @ gradient.T - crossed - crossed.T + moved
    spread = spread + errors.noise.bearing_variance * np.eye(transmitters.size)
    seen = np.eye(transmitters.size) - (0.0 if errors.noise.heading_referenced else 1.0 / transmitters.size)
    gain = with_error @ seen.T @ np.linalg.pinv(seen @ spread @ seen.T, hermitian=True) @ seen
    shared_moved = np.einsum("ia,aKb->iKb", gradient, error.shared)
    shared_moved = shared_moved - np.einsum("ia,iaKb->iKb", gradient, errors.covariance[transmitters])
    own = error.own - gain @ with_error.T
    return PositionError((own + own.T) / 2.0, error.shared - np.einsum("ai,iKb->aKb", gain, shared_moved)), gain
