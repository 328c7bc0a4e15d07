"""A stop monitor that tells everything it is told and what it answers: enough to have it decide once more, later.

Floating-point numbers are told to the last bit, and notes are numbered, so that a record of them can be trusted.
Whatever becomes of the notes, the flight goes on.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import msgspec
import numpy as np

from gcs.relay.leg_filter import Whereabouts
from gcs.relay.response import Agility
from gcs.relay.unrest import Unrest
from gcs.stop_monitor import ArrivalRule, StopMonitor
from planner.plan import Direction, Leg

log = logging.getLogger(__name__)

Pair = tuple[float, float]
"""A complex number."""


class SetUp(msgspec.Struct, frozen=True):
    """A monitor as it was made. Places in the formation frame, m; the covariance in m^2."""

    guide: str
    direction: Direction
    stop_reference: tuple[str, str]
    stop_angle_rad: float
    leg_start_m: Pair
    leg_end_m: Pair
    transmitters_m: dict[str, Pair]
    place_sigma_m: dict[str, float]
    start_m: Pair
    start_covariance_m2: tuple[Pair, Pair]
    rule: ArrivalRule
    heading_referenced: bool
    agility: Agility
    unrest: Unrest

    @classmethod
    def of(cls, monitor: StopMonitor) -> SetUp:
        """Return what a monitor was made of."""
        leg, ((xx, xy), (yx, yy)) = monitor.leg, np.asarray(monitor.start_covariance).tolist()
        return cls(
            guide=leg.guide,
            direction=leg.direction,
            stop_reference=leg.stop_reference,
            stop_angle_rad=float(leg.stop_angle_rad),
            leg_start_m=pair(leg.start),
            leg_end_m=pair(leg.end),
            transmitters_m={name: pair(at) for name, at in monitor.transmitters.items()},
            place_sigma_m=_floats(monitor.place_sigma_m),
            start_m=pair(monitor.start),
            start_covariance_m2=((xx, xy), (yx, yy)),
            rule=monitor.rule,
            heading_referenced=monitor.heading_referenced,
            agility=monitor.agility,
            unrest=monitor.unrest,
        )

    def monitor(self, time_s: float) -> StopMonitor:
        """Return the monitor as it was when it was made at `time_s`."""
        ends = complex(*self.leg_start_m), complex(*self.leg_end_m)
        return StopMonitor(
            Leg(self.guide, self.direction, self.stop_reference, self.stop_angle_rad, *ends),
            {name: complex(*at) for name, at in self.transmitters_m.items()},
            complex(*self.start_m),
            np.array(self.start_covariance_m2),
            time_s,
            self.rule,
            self.place_sigma_m,
            self.heading_referenced,
            self.agility,
            self.unrest,
        )


class Observed(msgspec.Struct, frozen=True, omit_defaults=True):
    """The directions of one report as they were taken in, and of whom they agreed."""

    directions_rad: dict[str, float]
    sigma_rad: dict[str, float]
    agreeing: list[str]
    resolution_rad: float = 0.0

    @classmethod
    def of(
        cls,
        directions_rad: Mapping[str, float],
        sigma_rad: Mapping[str, float],
        agreeing: frozenset[str],
        resolution_rad: float = 0.0,
    ) -> Observed:
        """Return a report and what became of it, the directions in their order."""
        return cls(_floats(directions_rad), _floats(sigma_rad), sorted(agreeing), float(resolution_rad))


class Asked(msgspec.Struct, frozen=True):
    """Where the receiver was found to be, along the leg from its end and to the left of it, and whether it arrived."""

    seen_m: Pair
    at_rest_m: Pair
    velocity_mps: Pair
    sigma_m: float
    arrived: bool

    @classmethod
    def of(cls, now: Whereabouts, *, arrived: bool) -> Asked:
        """Return an answer."""
        return cls(pair(now.seen), pair(now.at_rest), pair(now.velocity), float(now.sigma_m), arrived)


class MonitorNote(msgspec.Struct, frozen=True, omit_defaults=True):
    """One thing that a receiver's monitor was told or asked: made, begun anew, a report, a command, a decision.

    Times are those the monitor was given: of the service's monotonic clock. `number` counts from 0, when it was made.
    """

    number: int
    time_s: float
    made: SetUp | None = None
    begun: bool = False
    observed: Observed | None = None
    asked: Asked | None = None
    commanded_mps: Pair | None = None


Tell = Callable[[MonitorNote], None]
Trace = Callable[[str, MonitorNote], None]
"""Takes the notes of all monitors, with the receiver's name. Never blocks."""


def untraced(receiver: str, note: MonitorNote) -> None:
    """Take no note."""


@dataclass
class TracedMonitor(StopMonitor):
    """The same monitor; `tell` gets a note of every call."""

    tell: Tell = field(kw_only=True)
    _told: int = field(default=0, init=False)
    _failed: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._tell(lambda number: MonitorNote(number, float(self.time_s), made=SetUp.of(self)))

    def begin(self, now_s: float) -> None:
        """Begin anew."""
        super().begin(now_s)
        self._tell(lambda number: MonitorNote(number, float(now_s), begun=True))

    def commanded(self, time_s: float, velocity: complex) -> None:
        """Note a command."""
        super().commanded(time_s, velocity)
        self._tell(lambda number: MonitorNote(number, float(time_s), commanded_mps=pair(velocity)))

    def observe(
        self,
        captured_s: float,
        directions_rad: Mapping[str, float],
        sigma_rad: Mapping[str, float],
        resolution_rad: float = 0.0,
    ) -> frozenset[str]:
        """Take in a report."""
        agreeing = super().observe(captured_s, directions_rad, sigma_rad, resolution_rad)
        self._tell(
            lambda number: MonitorNote(
                number,
                float(captured_s),
                observed=Observed.of(directions_rad, sigma_rad, agreeing, resolution_rad),
            )
        )
        return agreeing

    def arrived(self, now: Whereabouts) -> bool:
        """Decide."""
        arrived = super().arrived(now)
        self._tell(lambda number: MonitorNote(number, float(now.time_s), asked=Asked.of(now, arrived=arrived)))
        return arrived

    def _tell(self, note: Callable[[int], MonitorNote]) -> None:
        number, self._told = self._told, self._told + 1
        try:
            self.tell(note(number))
        except Exception:
            if not self._failed:
                log.exception("what a stop monitor decides cannot be recorded; the flight goes on")
            self._failed = True


def pair(number: complex) -> Pair:
    """Return a complex number as JSON has it."""
    return float(number.real), float(number.imag)


def _floats(numbers: Mapping[str, float]) -> dict[str, float]:
    """Return numbers of any kind as JSON has them."""
    return {name: float(number) for name, number in numbers.items()}
