"""Guidance along a leg: how fast to fly, from the distance to go and the cross-track error alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs.stop_monitor import LegEstimate

LEAD_S = 0.5
"""Command delay plus most of the response: the distance flown before a new command bites."""


@dataclass(frozen=True)
class SpeedLimits:
    """What the vehicle may do, and the gains near the end of a leg."""

    speed_mps: float = 5.0
    deceleration_mps2: float = 2.5
    taper: float = 0.6
    """Share of the deceleration the plan uses; the rest is for wind and delay."""
    approach_per_s: float = 0.8
    cross_track_per_s: float = 0.8
    cross_track_mps: float = 1.5


def leg_velocity(estimate: LegEstimate, limits: SpeedLimits) -> tuple[float, float]:
    """Return the velocity to command: (along the leg, to its left), m/s, never faster than the limit.

    v = sqrt(2 * taper * a * d), with d what remains after the lead; proportional close to the end, so that an
    overshoot is crept back.
    """
    remaining_m = abs(estimate.remaining_m)
    ahead_m = max(
        0.0, remaining_m - LEAD_S * max(0.0, estimate.progress_mps * math.copysign(1.0, estimate.remaining_m))
    )
    along_mps = min(
        limits.speed_mps,
        math.sqrt(2.0 * limits.taper * limits.deceleration_mps2 * ahead_m),
        limits.approach_per_s * remaining_m,
    )
    across_mps = -limits.cross_track_per_s * estimate.cross_track_m
    across_mps = max(-limits.cross_track_mps, min(limits.cross_track_mps, across_mps))
    across_mps = max(-limits.speed_mps, min(limits.speed_mps, across_mps))
    along_mps = min(along_mps, math.sqrt(limits.speed_mps**2 - across_mps**2))
    return math.copysign(along_mps, estimate.remaining_m), across_mps
