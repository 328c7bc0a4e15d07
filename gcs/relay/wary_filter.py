"""A leg's filter that is not talked out of where it was: what contradicts the motion has to be borne out by a third.

While directions keep disagreeing, a second filter doubts the first: less sure with every report, it finds the place
that they would agree on. A vehicle that was blown off is found there. But two directions always agree on some place,
also when one of them lies: it counts only where the vehicle can have come to, flying as it was told. Not for a while
after the vehicle was forbidden to move, for what was told it then may not have reached it.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.relay.leg_filter import OUTLIER_SIGMAS, LegFilter, Whereabouts

_BY_CHANCE: Final = 1
"""So many reports in a row in which fewer than two directions agree mean nothing."""
_MAY_BE_ASTRAY_S: Final = 3.0
"""So long after it was forbidden to move a vehicle may be where it was not told to fly: its own time-out is as long."""
_POSSIBLE_SIGMAS: Final = 3.0
"""Once directions have disagreed they agree again within this: how a vehicle moves that brakes is known less well."""
_BLOWN_M: Final = 0.2
"""By how much the air may have moved a vehicle otherwise than the filter knows, one standard deviation on each axis."""


class WaryFilter:
    """A `LegFilter` that is trusted, and while directions disagree another that doubts it."""

    def __init__(self, trusted: LegFilter) -> None:
        self._trusted = trusted
        self._doubting: LegFilter | None = None
        self._begun = self._may_be_astray = False
        self._astray_until_s = float("-inf")
        self.disbelieved = False
        """Whether directions have come to agree on a place where the receiver cannot have come to.

        It gets less sure of that with time, and they are no truer for it: they count again when they agree with where
        the receiver was, or a third bears them out.
        """

    def begin(self, now_s: float) -> None:
        """Begin to follow the receiver; once more when it was forbidden to move."""
        if self._begun:
            self._astray_until_s = now_s + _MAY_BE_ASTRAY_S
        self._begun = True

    def commanded(self, time_s: float, velocity: complex) -> None:
        """Note the velocity commanded from `time_s` on, m/s, along the course and to its left."""
        self._trusted.commanded(time_s, velocity)
        if self._doubting is not None:
            self._doubting.commanded(time_s, velocity)

    def observe(
        self,
        captured_s: float,
        directions_rad: Mapping[str, float],
        sigma_rad: Mapping[str, float],
        resolution_rad: float = 0.0,
    ) -> frozenset[str]:
        """Take in the directions of one instant, polar, and return the transmitters whose directions agree.

        All of them must be known. Directions that are disbelieved do not agree.
        """
        within_sigmas = OUTLIER_SIGMAS if self._doubting is None else _POSSIBLE_SIGMAS
        agreeing = self._trusted.observe(captured_s, directions_rad, sigma_rad, within_sigmas, resolution_rad)
        if not self._trusted.disagreed:
            self._doubting, self.disbelieved = None, False
        elif self._doubting is not None:
            agreeing = self._doubt(self._doubting, captured_s, directions_rad, sigma_rad, resolution_rad)
        elif self._trusted.disagreed > _BY_CHANCE:
            self._doubting, self._may_be_astray = copy.deepcopy(self._trusted), captured_s <= self._astray_until_s
            self._doubting.widen()
        return agreeing

    @property
    def speed_mps(self) -> float:
        """How fast the receiver should have moved at the last report, by what was commanded."""
        return self._trusted.speed_mps

    def whereabouts(self, now_s: float) -> Whereabouts:
        """Return where the receiver is by `now_s`: from the last report on as commanded."""
        return self._trusted.whereabouts(now_s)

    def place(self) -> tuple[complex, NDArray[np.float64]]:
        """Return where the receiver was at the last report, formation frame, m, and its covariance, m^2."""
        return self._trusted.place()

    def standing_place(self) -> tuple[complex, NDArray[np.float64]]:
        """Return where it will stand once it has come to rest, formation frame, m, and the covariance, m^2."""
        return self._trusted.standing_place()

    def commanded_place(self) -> complex:
        """Return where commands alone should have brought it by the last report, formation frame, m."""
        return self._trusted.commanded_place()

    def _doubt(
        self,
        doubting: LegFilter,
        captured_s: float,
        directions_rad: Mapping[str, float],
        sigma_rad: Mapping[str, float],
        resolution_rad: float,
    ) -> frozenset[str]:
        """Tell the doubting filter, and trust it from now on when what it has found can be believed."""
        agreeing = doubting.observe(captured_s, directions_rad, sigma_rad, resolution_rad=resolution_rad)
        if doubting.disagreed:
            doubting.widen()
            return agreeing
        borne_out = self._may_be_astray or len(agreeing) > (3 if doubting.searched else 2)
        self.disbelieved = not borne_out and (self.disbelieved or self._off_sigmas(doubting) > _POSSIBLE_SIGMAS)
        if self.disbelieved:
            return frozenset()
        self._trusted, self._doubting = doubting, None
        return agreeing

    def _off_sigmas(self, doubting: LegFilter) -> float:
        """Return how far the doubting filter has the receiver from where it can be, standard deviations."""
        (place, covariance), (known, known_covariance) = doubting.place(), self._trusted.place()
        off = np.array([(place - known).real, (place - known).imag])
        possible = covariance + known_covariance + np.eye(2) * _BLOWN_M**2
        return math.sqrt(float(off @ np.linalg.solve(possible, off)))
