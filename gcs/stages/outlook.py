"""What a playbook would do, foreseen from its plan: nothing is opened, nothing flies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from gcs.playbook.schema import Playbook
from gcs.relay.settings import RelaySettings
from planner.plan import RelayPlan
from planner.relay import RelayProblem

CLIMB_MPS: Final = 2.0
RETURN_M: Final = 15.0
"""A copter with its default limits climbs to this before it flies home..."""
LOITER_S: Final = 5.0
"""...and waits there for so long before it lands..."""
DESCENT_MPS: Final = 1.5
TOUCH_DOWN_M: Final = 10.0
TOUCH_DOWN_MPS: Final = 0.5
"""...slower from the second height on."""


@dataclass(frozen=True)
class Foreseen:
    """One stage: what is done, how long that takes (None: as long as the operator likes), and its parts.

    `emission_transmitter_s` None: nobody is on the air but those kept on.
    """

    words: str
    duration_s: float | None
    parts: tuple[str, ...] = ()
    emission_transmitter_s: float | None = None


@dataclass
class Outlook:
    """What is known of a run before it; `kept_on` are the transmitters that emission stages keep on so far."""

    playbook: Playbook
    plan: RelayPlan
    kept_on: set[str] = field(default_factory=set)

    @property
    def problem(self) -> RelayProblem:
        """The problem that the plan solves."""
        return self.playbook.problem()

    @property
    def settings(self) -> RelaySettings:
        """How the relay is flown."""
        return RelaySettings.of(self.playbook.flight, self.playbook.planner.min_separation_m)

    @property
    def descent_s(self) -> float:
        """How long a landing takes."""
        return _landing_s(self.playbook.flight.altitude_m)

    @property
    def return_s(self) -> float:
        """How long a return takes besides the way home."""
        altitude_m = self.playbook.flight.altitude_m
        return max(0.0, RETURN_M - altitude_m) / CLIMB_MPS + LOITER_S + _landing_s(max(altitude_m, RETURN_M))

    def hearing_s(self, samples: int) -> float:
        """Return how long it takes until a sensor has reported so often."""
        return samples / self.playbook.sensor.rate_hz + self.playbook.sensor.latency_s

    def distances_home_m(self) -> Mapping[str, float]:
        """Return how far every UAV is from its start when the relay has formed."""
        targets = {route.receiver: route.target for route in self.plan.routes}
        return {name: abs(targets.get(name, start) - start) for name, start in self.playbook.uavs.items()}


def _landing_s(height_m: float) -> float:
    return max(0.0, height_m - TOUCH_DOWN_M) / DESCENT_MPS + min(height_m, TOUCH_DOWN_M) / TOUCH_DOWN_MPS
