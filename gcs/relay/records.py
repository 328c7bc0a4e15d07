"""What is known of each receiver while the relay runs, and what remains for the report."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.relay.states import ReceiverState
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
    measured_angle_rad: float | None = None
    """The latest subtended angle of the stop reference, as measured."""


@dataclass
class ReceiverRecord:
    """One receiver in the relay."""

    route: Route
    state: ReceiverState = ReceiverState.WAITING
    reason: str = ""
    legs: list[LegRecord] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The receiver's name."""
        return self.route.receiver

    @property
    def leg(self) -> LegRecord | None:
        """The leg being flown, or None between legs."""
        return self.legs[-1] if self.legs and self.legs[-1].ended_s is None else None
