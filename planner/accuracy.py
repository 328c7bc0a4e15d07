"""The errors of everything that stands, as one joint covariance: what the relay hands on.

Every error is linear in independent sources: the noise of each stop and of each line of bearing, and the error of each
located start. A placed UAV transmits from where it stands, not from where its slot is, so its error moves the lines and
angles of all that follow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.routes import Points

Reals = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class BearingNoise:
    """What the sensor and the first location are worth."""

    bearing_sigma_rad: float
    samples: int
    start_sigma_m: float
    heading_referenced: bool

    @property
    def bearing_variance(self) -> float:
        """Variance of one averaged bearing, rad^2."""
        return self.bearing_sigma_rad**2 / self.samples


@dataclass(frozen=True)
class PositionError:
    """Error of one receiver, m^2: its covariance, shape (2, 2), and that with every station, shape (2, K, 2)."""

    own: Reals
    shared: Reals

    @property
    def worst_axis_3sigma_m(self) -> float:
        """Three sigma along the worst axis, m."""
        return 3.0 * math.sqrt(max(float(np.linalg.eigvalsh(self.own)[-1]), 0.0))


@dataclass(frozen=True)
class LegLine:
    """A leg as geometry: the station that guides it, where it begins and where it ends; never of no length."""

    guide: int
    begin: complex
    end: complex

    @property
    def direction(self) -> complex:
        """Unit vector along the leg."""
        return (self.end - self.begin) / abs(self.end - self.begin)


class RelayErrors:
    """The joint error of all stations that stand: the first transmitters, exact, and every receiver placed since.

    `stations` are the places of all transmitters and slots, shape (K,), m; `covariance` has shape (K, 2, K, 2), m^2,
    and is zero for those that do not stand yet.
    """

    def __init__(self, stations: Points, noise: BearingNoise) -> None:
        self.stations = stations
        self.noise = noise
        self.covariance = np.zeros((stations.size, 2, stations.size, 2))

    def copy(self) -> RelayErrors:
        """Return an independent copy."""
        copied = RelayErrors.__new__(RelayErrors)
        copied.stations, copied.noise, copied.covariance = self.stations, self.noise, self.covariance.copy()
        return copied

    def at_start(self) -> PositionError:
        """Return the error of a receiver that has just been located."""
        return PositionError(np.eye(2) * self.noise.start_sigma_m**2, np.zeros((2, self.stations.size, 2)))

    def place(self, station: int, error: PositionError) -> None:
        """Let a receiver with this error stand at `station` from now on."""
        self.covariance[station] = error.shared
        self.covariance[:, :, station] = np.moveaxis(error.shared, 0, -1)
        self.covariance[station, :, station] = error.own

    def among(self, stations: Indices) -> Reals:
        """Return the covariances among t stations, shape (t, 2, t, 2)."""
        return self.covariance[stations][:, :, stations]

    def apart(self, error: PositionError, station: int) -> Reals:
        """Return the covariance of a receiver's error relative to that of a station, shape (2, 2)."""
        shared = error.shared[:, station]
        return np.asarray(error.own - shared - shared.T + self.covariance[station, :, station])


def bearing_gradient(at: ArrayLike, transmitters: ArrayLike) -> Reals:
    """Return how the direction from `at` to each transmitter turns as `at` moves, rad/m, last axis (x, y).

    Arguments broadcast and must not coincide.
    """
    offset = np.asarray(transmitters, dtype=np.complex128) - np.asarray(at, dtype=np.complex128)
    turned = 1j * offset / np.abs(offset) ** 2
    return -np.stack([turned.real, turned.imag], axis=-1)


def vector(point: complex) -> Reals:
    """Return a point as (x, y)."""
    return np.array([point.real, point.imag])
