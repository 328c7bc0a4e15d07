"""Guidance along a leg: how fast to fly, from where the receiver is and where it would come to rest, no more."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from gcs.relay.leg_filter import Whereabouts

AT_THE_END_M: Final = 0.3
"""Farther off than this nothing is flown that leads away: a vehicle that runs on is left to come back by itself."""


@dataclass(frozen=True)
class SpeedLimits:
    """What the vehicle may do, and the gains near the end of a leg."""

    speed_mps: float = 5.0
    deceleration_mps2: float = 2.5
    taper: float = 0.6
    """Share of the deceleration the plan uses; the rest is for wind and delay."""
    approach_per_s: float = 1.2
    cross_track_mps: float = 1.5
    drift_mps: float = 0.3
    """The fastest drift that is flown against."""


def leg_velocity(now: Whereabouts, limits: SpeedLimits) -> complex:
    """Return the velocity to command, m/s: along the leg and to its left, never faster than the limit.

    On each axis v = sqrt(2 * taper * a * d), with d from where the receiver would come to rest to where it should;
    proportional close to it. A steady drift is flown against.
    """
    across_limit_mps = min(limits.cross_track_mps, limits.speed_mps)
    across_mps = _clamped(_closing(now.at_rest.imag, now.seen.imag, now.drift.imag, limits), across_limit_mps)
    along_limit_mps = math.sqrt(limits.speed_mps**2 - across_mps**2)
    along_mps = _clamped(_closing(now.at_rest.real, now.seen.real, now.drift.real, limits), along_limit_mps)
    return complex(along_mps, across_mps)


def _closing(at_rest_m: float, seen_m: float, drift_mps: float, limits: SpeedLimits) -> float:
    """Return the velocity on one axis towards its zero."""
    if at_rest_m * seen_m <= 0.0 and abs(seen_m) > AT_THE_END_M:
        return 0.0
    far_mps = math.sqrt(2.0 * limits.taper * limits.deceleration_mps2 * abs(at_rest_m))
    against_mps = _clamped(drift_mps, limits.drift_mps)
    return -math.copysign(min(far_mps, limits.approach_per_s * abs(at_rest_m)), at_rest_m) - against_mps


def _clamped(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
