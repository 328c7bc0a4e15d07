"""A simulated relay that is judged by where its vehicles really are: how far each leg's stop was off."""

from __future__ import annotations

import cmath
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.session import Bus
from drivers.clock import Clock
from gcs.playbook.schema import Playbook
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import IN_FLIGHT, ReceiverState
from gcs.simulate.world import RelayWorld, Stop
from planner.angles import wrap
from planner.plan import Leg, RelayPlan

_SLOPE_STEP_M: Final = 0.01
_FLATTEST_RAD_PER_M: Final = 1e-9


@dataclass
class Scored:
    """What one receiver has done up to now; lengths along its last leg, m."""

    began_s: float | None = None
    placed_s: float | None = None
    stop_error_m: float | None = None
    overshoot_m: float | None = None
    hovered: list[complex] = field(default_factory=list)
    """Where it was at each measurement since `hover` began, formation frame, m."""
    legs: int = 0
    farthest_m: float = 0.0


class ScoredWorld(RelayWorld):
    """A world that is watched: nothing it sees reaches the relay."""

    def __init__(
        self, playbook: Playbook, plan: RelayPlan, clock: Clock, bus: Bus, *, seed: int, stop: Stop = "filtered"
    ) -> None:
        super().__init__(playbook, plan, clock, bus, seed=seed, stop=stop)
        self.scores: defaultdict[str, Scored] = defaultdict(Scored)
        self._hovering = False

    async def hover(self, duration_s: float) -> None:
        """Let everything go on for a while, and note where everybody is."""
        self._hovering = True
        await super().hover(duration_s)

    def announced(self, record: ReceiverRecord) -> None:
        """Note when a receiver began, and where it stood when it was PLACED."""
        score = self.scores[record.name]
        if record.state is ReceiverState.LOCATING and score.began_s is None:
            score.began_s = self.clock.now_s()
        if record.state is ReceiverState.PLACED:
            score.placed_s = self.clock.now_s()
            if record.legs:
                leg = record.legs[-1].leg
                stands = {name: self.frame.from_site(place) for name, place in self.places().items()}
                score.stop_error_m = stop_error_m(leg, stands[record.name], stands)
                score.overshoot_m = max(0.0, score.farthest_m - _along_m(leg, stands[record.name]))

    def measure(self) -> None:
        """Let every sensor measure, and note where everybody is."""
        super().measure()
        for name, record in self.executor.records.items():
            score, place = self.scores[name], self.frame.from_site(self.vehicles[name].place)
            if self._hovering:
                score.hovered.append(place)
            elif record.legs and record.state in IN_FLIGHT:
                along_m = _along_m(record.legs[-1].leg, place)
                score.farthest_m = max(score.farthest_m, along_m) if score.legs == len(record.legs) else along_m
                score.legs = len(record.legs)


def stop_error_m(leg: Leg, place: complex, stands: Mapping[str, complex]) -> float | None:
    """Return how far beyond the place where its stop angle is seen a receiver stands, along its leg, m.

    `stands` is where the transmitters really stand; None where the angle does not change along the leg.
    """
    first, second = (stands[name] for name in leg.stop_reference)

    def angle_rad(at: complex) -> float:
        return cmath.phase((second - at) / (first - at))

    step = _SLOPE_STEP_M * _course(leg)
    slope = wrap(angle_rad(place + step) - angle_rad(place - step)) / (2.0 * _SLOPE_STEP_M)
    return None if abs(slope) < _FLATTEST_RAD_PER_M else wrap(angle_rad(place) - leg.stop_angle_rad) / slope


def _along_m(leg: Leg, place: complex) -> float:
    """Return how far beyond its end a place is along a leg, m."""
    return ((place - leg.end) / _course(leg)).real


def _course(leg: Leg) -> complex:
    way = leg.end - leg.start
    return way / abs(way) if way else 1.0 + 0j
