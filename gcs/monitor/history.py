"""What screens show of the past of a run: flown tracks, angles over time, and who was in which state when."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.run_messages import Place, RunEvent, RunState

TRACK_STEP_M: Final = 0.5
TRACK_KEPT: Final = 2_000
ANGLES_KEPT: Final = 1_200
"""Four minutes of states."""


@dataclass(frozen=True)
class AngleSample:
    """The subtended angle a receiver measured on a leg, s since the run began."""

    elapsed_s: float
    leg: int
    angle_rad: float
    stop_angle_rad: float
    band_rad: float


@dataclass(frozen=True)
class Span:
    """A state of a receiver, s since the run began; one without an end lasts."""

    state: str
    from_s: float
    to_s: float | None = None


@dataclass
class RunHistory:
    """The past of one run as far as it was heard."""

    tracks: dict[str, deque[Place]] = field(default_factory=dict)
    """Where each vehicle was, formation frame, m; a point where it had moved a little."""
    angles: dict[str, deque[AngleSample]] = field(default_factory=dict)
    _entered: dict[str, dict[float, str]] = field(default_factory=dict)

    def take(self, state: RunState) -> None:
        """Take in a state."""
        for vehicle in state.vehicles:
            if vehicle.at_m is not None:
                track = self.tracks.setdefault(vehicle.name, deque(maxlen=TRACK_KEPT))
                if not track or math.dist(track[-1], vehicle.at_m) >= TRACK_STEP_M:
                    track.append(vehicle.at_m)
        for receiver in state.receivers:
            leg = receiver.leg
            if leg is not None and leg.angle_rad is not None:
                sample = AngleSample(state.elapsed_s, leg.number, leg.angle_rad, leg.stop_angle_rad, leg.band_rad)
                self.angles.setdefault(receiver.name, deque(maxlen=ANGLES_KEPT)).append(sample)
            if self._last_state(receiver.name) != receiver.state:
                self._entered.setdefault(receiver.name, {})[receiver.since_s] = receiver.state

    def note(self, event: RunEvent) -> None:
        """Take in an event, however late it comes."""
        if event.vehicle is not None and event.state is not None:
            self._entered.setdefault(event.vehicle, {})[event.elapsed_s] = event.state

    def spans(self, receiver: str) -> list[Span]:
        """Return the states of a receiver in order, each once until it changes."""
        entered = self._entered.get(receiver, {})
        spans: list[Span] = []
        for from_s in sorted(entered):
            if spans and spans[-1].state == entered[from_s]:
                continue
            if spans:
                spans[-1] = Span(spans[-1].state, spans[-1].from_s, from_s)
            spans.append(Span(entered[from_s], from_s))
        return spans

    def _last_state(self, receiver: str) -> str | None:
        entered = self._entered.get(receiver)
        return entered[max(entered)] if entered else None
