"""The observer: watches one relay from outside and finds what must never happen. It shares nothing with the executor.

It sees what is on the wire, bearing reports, commands and the states that are told, and the truth besides: where
everybody is, when a report was captured, who has a pilot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Final

from drivers.bus.messages import BearingReport
from gcs.faults.findings import Findings
from gcs.faults.hearing import Hearing

BRAKING_S: Final = 3.0
"""A copter stops within this from its fastest."""
_ZERO_MPS: Final = 1e-6
_LATE_S: Final = 0.02
_SPEED_OVER_S: Final = 0.5
_OBJECTED_S: Final = 0.4
"""After this at the latest nobody flies on who has come too near: telemetry, and a report's period."""
_LEG_S: Final = (30.0, 3.0)
"""A leg takes no longer than the first, and the second times what it takes at full speed..."""
_LEG_M: Final = (10.0, 1.25)
"""...and leads no farther than the first, and the second times its length."""
_IGNORED: Final = (1.0, 0.25, 10.0)
"""Told to fly as fast as the first, m/s, and flying less than the second's share of that, a vehicle follows nobody: it
is not told so for longer than the third, s."""
_ABOUT_M: Final = 1.0
"""How far a transmitter may stand from where it is taken to stand."""
_NOT_UNDER_WAY: Final = frozenset({"WAITING", "PLACED", "HELD", "PILOT", "FAILED"})
_LEGS: Final = frozenset({"LEG_1", "LEG_2", "TRIMMING"})


@dataclass(frozen=True)
class Rules:
    """What the observer holds a relay to."""

    lease_s: float
    oldest_report_s: float
    speed_mps: float
    too_near_m: float
    """Vehicles that the service flies never come nearer than this..."""
    tolerance_m: float
    """...and nobody is PLACED farther from its slot."""
    standing_mps: float = 0.5
    """Slower is at rest."""


@dataclass(frozen=True)
class Sight:
    """What is seen of one vehicle. Site frame, north + i east."""

    place: complex
    command: complex
    piloted: bool = False
    adrift: bool = False
    """Whether it moves besides what it is told."""
    heard: bool = True
    """Whether its telemetry arrives."""


@dataclass(frozen=True)
class MustStop:
    """Who must be at rest, from when until when, and why."""

    vehicles: Collection[str]
    from_s: float
    until_s: float
    why: str


@dataclass
class _Leg:
    began_s: float
    start: complex
    length_m: float


@dataclass
class Observer:
    """Watches one relay; `findings` are what it has found."""

    rules: Rules
    receivers: Collection[str]
    findings: Findings = field(default_factory=Findings)
    stops: list[MustStop] = field(default_factory=list)
    ended: bool = False
    """Whether the relay has ended: nobody is commanded any more."""
    lied_to: bool = False
    """Whether bearings have said something else than the truth."""
    closest_m: float = float("inf")
    hearings: dict[str, Hearing] = field(init=False)
    states: dict[str, str] = field(default_factory=dict)
    _legs: dict[str, _Leg] = field(default_factory=dict)
    _near_since_s: dict[str, float] = field(default_factory=dict)
    _ignored_since_s: dict[str, float] = field(default_factory=dict)
    _tracks: dict[str, deque[tuple[float, complex]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.hearings = {name: Hearing(self.rules.oldest_report_s) for name in self.receivers}

    def reported(self, name: str, now_s: float, captured_s: float, report: BearingReport) -> None:
        """See a report delivered that was truly captured then."""
        self.hearings[name].take(now_s, captured_s, report)

    def commanded(self, name: str, now_s: float, velocity: complex, *, piloted: bool) -> None:
        """See a command given to a vehicle."""
        if piloted:
            self.findings.add("pilot", name, now_s, f"it is told to fly {abs(velocity):.2f} m/s and has a pilot")
        if abs(velocity) > _ZERO_MPS:
            self._require_fresh(name, now_s)
            if self.ended:
                self.findings.add("ended", name, now_s, "it is told to fly after the relay's end")

    def told(self, name: str, now_s: float, state: str, place: complex, leg_m: float) -> None:
        """See a state told, other than the last one; `leg_m` is the length of the leg it begins or trims."""
        self.states[name] = state
        self._legs.pop(name, None)
        if state in _LEGS:
            self._legs[name] = _Leg(now_s, place, leg_m)
        if state == "VERIFYING":
            self.hearings[name].azimuths_rad.clear()

    def placed(
        self,
        name: str,
        now_s: float,
        off: tuple[complex, float],
        transmitters: Mapping[str, complex],
        sigma_rad: float,
        *,
        lied_to: bool,
        from_north: bool,
    ) -> bool:
        """See a receiver PLACED; `off` is its slot and how far it is from it. Return whether it is wrong, and unseen.

        Whoever is `lied_to` cannot know better, unless what it heard last passes by the slot.
        """
        slot, off_m = off
        if off_m <= self.rules.tolerance_m:
            return False
        seen = self.hearings[name].farthest_off_m(slot, transmitters, sigma_rad) if from_north else None
        if not lied_to:
            self.findings.add("placement", name, now_s, f"PLACED {off_m:.1f} m from its slot")
        elif seen is not None and seen[0] > self.rules.tolerance_m + _ABOUT_M:
            what = f"PLACED {off_m:.1f} m from its slot; the bearings of {seen[1]} pass it by {seen[0]:.1f} m"
            self.findings.add("placement", name, now_s, what)
        else:
            return True
        return False

    def look(self, now_s: float, sights: Mapping[str, Sight]) -> None:
        """See where everybody is and what everybody is told just now."""
        for name, sight in sights.items():
            track = self._tracks.setdefault(name, deque())
            track.append((now_s, sight.place))
            while now_s - track[0][0] > _SPEED_OVER_S + _LATE_S:
                track.popleft()
            if abs(sight.command) > _ZERO_MPS:
                self._look_at_command(name, now_s, sight)
            self._look_at_following(name, now_s, sight)
            self._look_at_leg(name, now_s, sight)
        self._look_at_separation(now_s, sights)
        self._look_at_stops(now_s, sights)

    def speed_mps(self, name: str) -> float:
        """Return how fast a vehicle has moved lately."""
        track = self._tracks[name]
        (then_s, then), (now_s, now) = track[0], track[-1]
        return abs(now - then) / (now_s - then_s) if now_s - then_s > _SPEED_OVER_S / 2.0 else 0.0

    def _look_at_command(self, name: str, now_s: float, sight: Sight) -> None:
        self._require_fresh(name, now_s)
        if sight.piloted:
            self.findings.add("pilot", name, now_s, f"{abs(sight.command):.2f} m/s is streamed, and it has a pilot")
        if self.states.get(name, "WAITING") in _NOT_UNDER_WAY:
            state = self.states.get(name, "WAITING")
            self.findings.add("ended", name, now_s, f"it is {state} and told to fly {abs(sight.command):.2f} m/s")

    def _require_fresh(self, name: str, now_s: float) -> None:
        heard = self.hearings.get(name)
        for_s = now_s - heard.fresh_s if heard is not None else float("inf")
        if for_s > self.rules.lease_s + _LATE_S:
            self.findings.add("fresh_bearing", name, now_s, f"it is told to fly, {for_s:.2f} s after a fresh bearing")

    def _look_at_following(self, name: str, now_s: float, sight: Sight) -> None:
        least_mps, share, longest_s = _IGNORED
        if abs(sight.command) < least_mps or self.speed_mps(name) > share * abs(sight.command):
            self._ignored_since_s.pop(name, None)
            return
        for_s = now_s - self._ignored_since_s.setdefault(name, now_s)
        if for_s > longest_s:
            what = f"it has been told to fly for {for_s:.1f} s, and stands"
            self.findings.add("followed", name, now_s, what)

    def _look_at_leg(self, name: str, now_s: float, sight: Sight) -> None:
        leg = self._legs.get(name)
        if leg is None:
            return
        longest_s = _LEG_S[0] + _LEG_S[1] * leg.length_m / self.rules.speed_mps + self.rules.lease_s + _OBJECTED_S
        longest_m = _LEG_M[0] + _LEG_M[1] * leg.length_m
        if now_s - leg.began_s > longest_s:
            self.findings.add("leg_time", name, now_s, f"a leg of {leg.length_m:.1f} m takes over {longest_s:.1f} s")
        if (flown_m := abs(sight.place - leg.start)) > longest_m and not sight.piloted:
            self.findings.add("leg_length", name, now_s, f"{flown_m:.1f} m on a leg of {leg.length_m:.1f} m")

    def _look_at_separation(self, now_s: float, sights: Mapping[str, Sight]) -> None:
        """Who follows the service never comes too near another who does; to anybody else it does not fly on."""
        near: dict[str, str] = {}
        for (one, first), (other, second) in combinations(sights.items(), 2):
            apart_m = abs(first.place - second.place)
            strays = first.piloted or second.piloted or first.adrift or second.adrift
            if not strays:
                self.closest_m = min(self.closest_m, apart_m)
            if apart_m >= self.rules.too_near_m:
                continue
            if not strays:
                self.findings.add("separation", one, now_s, f"{apart_m:.1f} m from {other}")
            if first.heard and second.heard:
                near |= {one: other, other: one}
        for name in list(self._near_since_s.keys() - near.keys()):
            del self._near_since_s[name]
        for name, other in near.items():
            since_s = self._near_since_s.setdefault(name, now_s)
            if now_s - since_s > _OBJECTED_S and abs(sights[name].command) > _ZERO_MPS:
                self.findings.add("separation", name, now_s, f"it flies on, too near {other}")

    def _look_at_stops(self, now_s: float, sights: Mapping[str, Sight]) -> None:
        self.stops = [stop for stop in self.stops if stop.until_s > now_s]
        for stop in self.stops:
            if now_s < stop.from_s + _SPEED_OVER_S:
                continue
            for name in sorted(stop.vehicles):
                speed_mps = self.speed_mps(name)
                if speed_mps > self.rules.standing_mps and not (sights[name].adrift or sights[name].piloted):
                    what = f"{speed_mps:.2f} m/s when it should long have stopped: {stop.why}"
                    self.findings.add("stopped", name, now_s, what)
