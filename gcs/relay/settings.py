"""How a relay is flown."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.guidance import SpeedLimits
from gcs.playbook.schema import Flight
from planner.plan import Leg


@dataclass(frozen=True)
class RelaySettings:
    """Speeds, samples and limits of the relay."""

    limits: SpeedLimits = field(default_factory=SpeedLimits)
    min_separation_m: float = 5.0
    locate_samples: int = 10
    verify_samples: int = 20
    settle_s: float = 1.0
    """Between the stop and the verification: the vehicle comes to rest."""
    placement_tolerance_m: float = 3.0
    start_tolerance_m: float = 20.0
    gap_s: float = 0.5
    """Without a usable bearing for this long: zero velocity."""
    give_up_s: float = 5.0
    """Without one for this long: HELD."""

    @classmethod
    def of(cls, flight: Flight, min_separation_m: float) -> RelaySettings:
        """Return the settings that a playbook's `flight` section asks for."""
        return cls(
            limits=SpeedLimits(speed_mps=flight.speed_mps),
            min_separation_m=min_separation_m,
            placement_tolerance_m=flight.placement_tolerance_m,
            give_up_s=flight.give_up_s,
        )

    def longest_leg_s(self, leg: Leg) -> float:
        """Return the time after which a leg has gone wrong, s."""
        return 30.0 + 3.0 * leg.length_m / self.limits.speed_mps
