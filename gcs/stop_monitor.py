"""The stop-condition monitor of one leg: bearings in, stop decisions out. No position ever enters it.

The leg is a line through its guide, and ends where the subtended angle of its stop reference equals the stop angle.
Where the receiver is on it follows from the measured directions and from what was commanded (`leg_filter`). The leg
ends when the place at which the receiver would come to rest has stayed within a band about that end for a dwell: never
on one sample, and neither before the end nor beyond it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.relay.following import Following
from gcs.relay.leg_filter import LegFilter, Whereabouts
from gcs.relay.repetition import Repetition
from gcs.relay.response import Agility
from gcs.relay.unrest import Nose, Unrest
from gcs.relay.wary_filter import WaryFilter
from planner.plan import Leg

_OF_SIGMA: Final = 0.25
"""The band is no narrower than this share of what the filter can tell: nearer is luck."""
_SWAYS: Final = 2.0
_UNDER_WAY_MPS: Final = 0.5
_NEAR_M: Final = 1.5
_PATIENCE_S: Final = 8.0
"""A vehicle that flies what it is told comes from near to arrived in less."""
_WIDENING_MPS: Final = 0.1


@dataclass(frozen=True)
class ArrivalRule:
    """When a leg counts as ended: how near to its end, for how long, and whether also on its line."""

    band_m: float
    dwell_s: float
    on_line: bool
    widest_m: float = 0.0
    """What the band widens to for a vehicle that has been near for a while and does not hold still better."""
    sway_m: float = 0.3
    """How far from there the vehicle itself may be, in calm air: it runs on before it returns."""


TURN = ArrivalRule(band_m=0.15, dwell_s=0.3, on_line=False, widest_m=0.6, sway_m=1.0)
"""For a leg whose end is a turning point: the next leg takes out what is left."""
SLOT = ArrivalRule(band_m=0.1, dwell_s=1.0, on_line=True, widest_m=0.6)
"""For the leg that ends in the slot."""


@dataclass(frozen=True)
class LegEstimate:
    """Where the receiver is on its leg, from angles alone."""

    remaining_m: float
    cross_track_m: float
    progress_mps: float
    remaining_sigma_m: float


@dataclass
class StopMonitor:
    """Follows one leg. `transmitters` are the known places of all it may hear, formation frame, m.

    `start` and `start_covariance` (m^2) are the receiver's located place, `time_s` when it was there. `place_sigma_m`
    says how well the places of transmitters are known, per axis; nothing said: exactly. Directions are measured from
    north, or else all from the receiver's nose, wherever that points.
    """

    leg: Leg
    transmitters: Mapping[str, complex]
    start: complex
    start_covariance: NDArray[np.float64]
    time_s: float
    rule: ArrivalRule
    place_sigma_m: Mapping[str, float] = field(default_factory=dict)
    heading_referenced: bool = True
    agility: Agility = field(default_factory=Agility)
    unrest: Unrest = field(default_factory=Unrest)
    outliers: int = 0
    """Directions that did not agree with the others and with the motion."""
    _told_mps: float = field(default=0.0, init=False)
    _within_since_s: float | None = field(default=None, init=False)
    _following: Following = field(default_factory=Following, init=False)

    def __post_init__(self) -> None:
        towards_guide = self.transmitters[self.leg.guide] - self.leg.end
        self.course = towards_guide / abs(towards_guide) * (1.0 if self.leg.direction == "towards" else -1.0)
        self._near_since_s = self.time_s
        self._repetition = Repetition(self.transmitters)
        self._filter = WaryFilter(
            LegFilter(
                self.leg.end,
                self.course,
                self.transmitters,
                self.place_sigma_m,
                self.start,
                self.start_covariance,
                self.time_s,
                self.agility,
                self.unrest,
                None if self.heading_referenced else Nose(),
            )
        )

    def begin(self, now_s: float) -> None:
        """Begin to fly to the leg's end now, perhaps not for the first time: arriving takes its time anew.

        Whoever begins once more was stopped on the way, and may not have heard of it at once.
        """
        self._within_since_s, self._near_since_s = None, now_s
        self._following.begin()
        self._repetition.begin()
        self._filter.begin(now_s)

    def commanded(self, time_s: float, velocity: complex) -> None:
        """Note the velocity commanded from `time_s` on, m/s: along the leg, and to its left."""
        self._told_mps = abs(velocity)
        self._filter.commanded(time_s, velocity)

    def observe(
        self,
        captured_s: float,
        directions_rad: Mapping[str, float],
        sigma_rad: Mapping[str, float],
        resolution_rad: float = 0.0,
    ) -> frozenset[str]:
        """Take in the directions of one report, polar, formation frame; return whose directions agree.

        They agree with each other and with the motion. They are rounded to the nearest `resolution_rad` of what the
        sensor measured, which `sigma_rad` is of; 0: not rounded. The report of a stuck sensor is no news, whatever its
        time says.
        """
        known = {name: direction for name, direction in directions_rad.items() if name in self.transmitters}
        under_way = max(self._told_mps, self._filter.speed_mps) > _UNDER_WAY_MPS
        self._repetition.note(known, resolution_rad, self._filter.commanded_place(), under_way=under_way)
        if self.stuck:
            return frozenset()
        agreeing = self._filter.observe(captured_s, known, sigma_rad, resolution_rad)
        self.outliers += len(known) - len(agreeing)
        if len(agreeing) > 1:
            place, covariance = self._filter.place()
            sigma_m = math.sqrt(float(np.trace(covariance)))
            self._following.note(captured_s, self._filter.commanded_place(), place, sigma_m)
        return agreeing

    @property
    def stuck(self) -> bool:
        """Whether the sensor showed in the last report what it had shown before, and could not any more."""
        return self._repetition.stuck

    @property
    def disbelieved(self) -> bool:
        """Whether directions have come to agree on a place where the receiver cannot have come to."""
        return self._filter.disbelieved

    @property
    def unfollowed(self) -> bool:
        """Whether the receiver, by its bearings, has lately not flown what was commanded."""
        return self._following.lost

    @property
    def dwelling(self) -> bool:
        """Whether the stop condition held when it was last asked for."""
        return self._within_since_s is not None

    def whereabouts(self, now_s: float) -> Whereabouts:
        """Return where the receiver is by `now_s`, and where it would come to rest.

        It is carried on from the last report with what was commanded.
        """
        return self._filter.whereabouts(now_s)

    def estimate(self, now: Whereabouts) -> LegEstimate:
        """Return the same in the words of the leg."""
        return LegEstimate(-now.seen.real, now.seen.imag, now.velocity.real, now.sigma_m)

    def arrived(self, now: Whereabouts) -> bool:
        """Return whether the stop condition holds: near, without a break, for the dwell."""
        rule = self.rule
        off_m = self._off_m(now.at_rest)
        band_m = max(self._band_m(off_m, now.time_s), _OF_SIGMA * now.sigma_m)
        if off_m > band_m or self._off_m(now.seen) > max(rule.sway_m, band_m, _SWAYS * now.sway_m, now.sigma_m):
            self._within_since_s = None
            return False
        if self._within_since_s is None:
            self._within_since_s = now.time_s
        return now.time_s - self._within_since_s >= rule.dwell_s

    def place(self) -> tuple[complex, NDArray[np.float64]]:
        """Return the receiver's place at the last report, formation frame, m, and its covariance, m^2."""
        return self._filter.place()

    def standing_place(self) -> tuple[complex, NDArray[np.float64]]:
        """Return the same of where it will stand once it has come to rest."""
        return self._filter.standing_place()

    def _off_m(self, place: complex) -> float:
        return max(abs(place.real), abs(place.imag)) if self.rule.on_line else abs(place.real)

    def _band_m(self, off_m: float, now_s: float) -> float:
        """Return how near is near enough: the rule's band, widened for a vehicle that hovers about its end."""
        if off_m > _NEAR_M:
            self._near_since_s = now_s
        waited_s = max(0.0, now_s - self._near_since_s - _PATIENCE_S)
        return max(self.rule.band_m, min(self.rule.band_m + _WIDENING_MPS * waited_s, self.rule.widest_m))
