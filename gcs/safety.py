"""Safety: why a vehicle must not move now. Positions are used here, and only to forbid."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final, Protocol

from gcs.fence import outside_m
from gcs.playbook.schema import Flight
from gcs.separation import Keeping, nearest_m

_LONGER_S: Final = 1.0


@dataclass(frozen=True)
class SitePosition:
    """Where a vehicle says it is: site frame, north + i east, m; m above home; when it was heard, s."""

    time_s: float
    north_east: complex
    height_m: float
    braking_way: complex = 0j
    """How it would still come if it were told to stop now, m."""


@dataclass
class PositionBoard:
    """The latest position of every vehicle, from its telemetry."""

    latest: dict[str, SitePosition] = field(default_factory=dict)

    def smallest_separation_m(self, name: str) -> tuple[float, str] | None:
        """Return the distance to the nearest other vehicle and its name, or None when one cannot be told."""
        own = self.latest.get(name)
        if own is None:
            return None
        others = ((abs(p.north_east - own.north_east), other) for other, p in self.latest.items() if other != name)
        return min(others, default=None)

    def nearest_braked_m(self, name: str) -> tuple[float, str] | None:
        """Return how near the nearest other vehicle comes if all brake from now on, and its name; or None as above."""
        own = self.latest.get(name)
        if own is None:
            return None
        others = (
            (nearest_m(p.north_east - own.north_east, p.braking_way - own.braking_way), other)
            for other, p in self.latest.items()
            if other != name
        )
        return min(others, default=None)

    def apart_m(self, name: str, other: str) -> float:
        """Return the distance of two vehicles that have told where they are."""
        return abs(self.latest[name].north_east - self.latest[other].north_east)


class Telemetered(Protocol):
    """What safety asks of a vehicle."""

    def silent_for_s(self) -> float:
        """Return the time since its last message, s."""
        ...


@dataclass(frozen=True)
class SafetyLimits:
    """When a vehicle must not move."""

    telemetry_gap_s: float = 0.5
    min_separation_m: float = 5.0
    separation_share: float = 0.8
    """Share of the planned separation below which no vehicle comes: the plan keeps the whole. Who would, stops."""
    kept_apart_s: float = 6.0
    """For so long it is kept from flying on there."""
    empty_battery_percent: int = 15
    """With no more left a vehicle is not flown on: it has to be landed."""
    over_the_fence_m: float = 3.0
    """How far outside the fence a vehicle may be by its own position: the plan keeps within."""
    standing_m: float = 3.0
    """How far a transmitter from the start may tell to be from its place and still count as standing there."""

    @classmethod
    def of(cls, flight: Flight, min_separation_m: float) -> SafetyLimits:
        """Return the limits for a playbook's `flight` section: who is kept apart is so until its leg is given up."""
        return cls(min_separation_m=min_separation_m, kept_apart_s=flight.give_up_s + _LONGER_S)


def _unknown(name: str) -> None:
    """Tell nothing of a vehicle's battery."""


@dataclass(frozen=True)
class Safety:
    """Looks at one vehicle at a time. Where the board holds no positions it cannot watch the separation."""

    vehicles: Mapping[str, Telemetered]
    bus_connected: Callable[[], bool]
    limits: SafetyLimits
    positions: PositionBoard
    places: Mapping[str, complex] = field(default_factory=dict)
    """Where the transmitters from the start should stand, site frame, m."""
    battery_percent: Callable[[str], int | None] = _unknown
    """What a vehicle tells to have left; None: it does not know."""
    fence: Sequence[complex] = ()
    """Corners, site frame, m; none: there is no fence."""
    _keeping: Keeping = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_keeping", Keeping(self.limits.kept_apart_s))

    def objection(self, name: str) -> str | None:
        """Return why this vehicle must not move now, or None."""
        silent_s = self.vehicles[name].silent_for_s()
        if silent_s > self.limits.telemetry_gap_s:
            return f"no telemetry for {silent_s:.1f} s: check its link and autopilot"
        if not self.bus_connected():
            return "the bus router cannot be reached: check that it runs"
        if (near := self._too_near(name)) is not None:
            return near
        percent = self.battery_percent(name)
        if percent is not None and percent <= self.limits.empty_battery_percent:
            return f"its battery is down to {percent} %: land it"
        return self._over_the_fence(name) or self._astray(name)

    def _too_near(self, name: str) -> str | None:
        """Return whom a vehicle is too near, or would be before it stands, or is kept from for that."""
        nearest = self.positions.nearest_braked_m(name)
        if nearest is None:
            return None
        (braked_m, other), told = nearest, self.positions.latest[name]
        too_near_m = self.limits.separation_share * self.limits.min_separation_m
        apart_m = partial(self.positions.apart_m, name)
        if braked_m < too_near_m:
            self._keeping.note(name, other, told.time_s, apart_m(other))
            ahead = "" if apart_m(other) < too_near_m else f", and braking from now it would be {braked_m:.1f} m"
            return f"only {apart_m(other):.1f} m from {other}{ahead}"
        kept_from = self._keeping.still_from(name, told.time_s, apart_m)
        return None if kept_from is None else f"it is kept from {kept_from}, {apart_m(kept_from):.1f} m away"

    def _over_the_fence(self, name: str) -> str | None:
        """Return how far a vehicle is outside the fence, when that is too far."""
        told = self.positions.latest.get(name)
        over_m = 0.0 if told is None else outside_m(told.north_east, self.fence)
        if over_m <= self.limits.over_the_fence_m:
            return None
        return f"it is {over_m:.1f} m outside the fence: have its pilot bring it back"

    def _astray(self, name: str) -> str | None:
        """Return how far a transmitter from the start is from its place, when that is too far."""
        place, told = self.places.get(name), self.positions.latest.get(name)
        if place is None or told is None or abs(told.north_east - place) <= self.limits.standing_m:
            return None
        return f"it is {abs(told.north_east - place):.1f} m from its place: have its pilot bring it back"
