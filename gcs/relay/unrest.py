"""How vehicles move besides what they are commanded, in calm air and in rougher: what a leg's filter expects."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_PARTS = 4
"""Held place, speed, sway and drift, each on two axes."""


@dataclass(frozen=True)
class Unrest:
    """How vehicles move besides their response to commands: in calm air; rougher air is noticed."""

    speed_s: float = 0.5
    speed_noise: float = 0.3
    """For how long and how far the speed strays, per m/s that it is from the command, m/s per square root of a second:
    the farther, the less the response is known..."""
    sway_s: float = 2.0
    sway_m: float = 0.05
    sway_noise: float = 0.1
    """...how long and how far one sways, and how far besides, per m/s2, m per square root of a second..."""
    drift_s: float = 20.0
    drift_mps: float = 0.03
    """...and how long and how fast one drifts."""

    def transition(self, step_s: float) -> NDArray[np.float64]:
        """Return how (held, speed, sway, drift) carry on by themselves, shape (8, 8)."""
        kept, size = math.exp(-step_s / self.speed_s), 2 * _PARTS
        carried = np.eye(size)
        for axis in (0, 1):
            held, speed, sway, drift = range(axis, size, 2)
            carried[held, speed] = self.speed_s * (1.0 - kept)
            carried[held, drift] = step_s
            carried[speed, speed] = kept
            carried[sway, sway] = math.exp(-step_s / self.sway_s)
            carried[drift, drift] = math.exp(-step_s / self.drift_s)
        return carried

    def swayed_m2(self, step_s: float, roughness: float) -> float:
        """Return the variance that swaying adds on each axis, m^2, where it is `roughness` times that of calm air."""
        return roughness * self.sway_m**2 * -math.expm1(-2.0 * step_s / self.sway_s)

    def added(
        self, step_s: float, roughness: float, unanswered_mps: float, acceleration_mps2: float
    ) -> NDArray[np.float64]:
        """Return the variance added on each axis to (held, speed, sway, drift), shape (8,).

        `unanswered_mps` is how far the speed is from the command, `acceleration_mps2` how much it changes.
        """
        added = [
            0.0,
            (self.speed_noise * unanswered_mps) ** 2 * step_s,
            self.swayed_m2(step_s, roughness) + (self.sway_noise * acceleration_mps2) ** 2 * step_s,
            self.drift_mps**2 * -math.expm1(-2.0 * step_s / self.drift_s),
        ]
        return np.repeat(added, 2)


@dataclass(frozen=True)
class Nose:
    """How the nose of a vehicle moves that holds its heading: it yaws about where it points, and that wanders."""

    yaw_rad: float = math.radians(0.2)
    """In calm air; rougher air is noticed."""
    yaw_s: float = 1.0
    wander_rad: float = math.radians(0.02)
    """Per square root of a second."""

    def yawed_rad2(self, step_s: float, roughness: float) -> float:
        """Return the variance that yawing adds, rad^2, where it is `roughness` times that of calm air."""
        return roughness * self.yaw_rad**2 * -math.expm1(-2.0 * step_s / self.yaw_s)
