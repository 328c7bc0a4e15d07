"""Whether a receiver that hovers stands in its slot, or a trim leg would bring it nearer."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.errors import HoldRequiredError
from gcs.relay.leg_flight import DISBELIEVED
from gcs.relay.standing import sigma_towards_m, worst_sigma_m
from planner.plan import Route
from planner.positioning import Fix

_TRIMMED_M: Final = 0.3
"""Nearer to its slot nobody is trimmed: a stop is no better."""
_TRIMMED_SIGMAS: Final = 1.5
_ALLOWED_SIGMAS: Final = 3.0


def worth_trimming(off: complex, covariance: NDArray[np.float64]) -> bool:
    """Return whether a trim leg would bring a receiver nearer: its offset, m, is known better than it is small."""
    return abs(off) > max(_TRIMMED_M, _TRIMMED_SIGMAS * sigma_towards_m(off, covariance))


def require_in_slot(
    route: Route,
    fix: Fix,
    place: complex,
    covariance: NDArray[np.float64],
    tolerance_m: float,
    *,
    disbelieved: bool,
) -> None:
    """Return when a receiver stands in its slot; HoldRequiredError when it is too far off, or that is not known.

    `fix` is where bearings put it now, `place` where its last leg and those bearings put it together, m. Where they are
    `disbelieved` nobody knows.
    """
    for known_as, at in (("bearings put it", fix.position), ("its last leg and bearings put it", place)):
        allowed_m = tolerance_m + _ALLOWED_SIGMAS * sigma_towards_m(at - route.target, fix.covariance)
        if abs(at - route.target) > allowed_m:
            raise HoldRequiredError(
                f"{known_as} {abs(at - route.target):.1f} m from {route.slot} (allowed are {allowed_m:.1f} m)"
            )
    if disbelieved:
        raise HoldRequiredError(DISBELIEVED)
    if worst_sigma_m(covariance) > tolerance_m:
        raise HoldRequiredError(
            f"it is not known to {tolerance_m:g} m whether it stands in {route.slot}: it hears too few transmitters"
        )
