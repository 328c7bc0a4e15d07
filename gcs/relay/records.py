"""What is known of each receiver while the relay runs, and what remains for the report."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs.relay.states import IN_FLIGHT, ReceiverState
from gcs.stop_monitor import LegEstimate
from planner.plan import Leg, Route


@dataclass
class LegRecord:
    """One leg as flown."""

    leg: Leg
    started_s: float
    ended_s: float | None = None
    stop_angle_error_rad: float | None = None
    estimate: LegEstimate | None = None
    outliers: int = 0
    """Directions that did not agree with the others and with the motion."""
    measured_angle_rad: float | None = None
    """The latest subtended angle of the stop reference, as measured."""


@dataclass
class ReceiverRecord:
    """One receiver in the relay."""

    route: Route
    state: ReceiverState = ReceiverState.WAITING
    reason: str = ""
    legs: list[LegRecord] = field(default_factory=list)
    """The legs flown since it was last located."""
    place: complex | None = None
    """Where bearings put it last, formation frame, m..."""
    covariance: NDArray[np.float64] | None = None
    """...and the covariance of that, m^2."""
    strayed: bool = False
    """Whether a pilot has had it since: it may be anywhere."""
    off_plan: bool = False
    """Whether it cannot keep to its planned route: somebody else has moved it, or it has no way along it."""

    @property
    def name(self) -> str:
        """The receiver's name."""
        return self.route.receiver

    @property
    def leg(self) -> LegRecord | None:
        """The leg being flown, or None between legs and while it is held."""
        flying = self.state in IN_FLIGHT and bool(self.legs) and self.legs[-1].ended_s is None
        return self.legs[-1] if flying else None
