"""The relay problem, and what an order of routes costs in time and emission."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from planner.errors import ProblemError
from planner.plan import Route

Objective = Literal["length", "makespan", "emission", "balanced"]


@dataclass(frozen=True)
class RelayProblem:
    """What is to be planned: who transmits from the start, who receives and from where, and which slots to fill.

    Points are in the formation frame, m; mappings keep their order, and slots come in relay order. With more receivers
    than slots a method may leave receivers waiting at their starts; with fewer, slots free. Raises ProblemError when it
    is no problem that could be planned.
    """

    transmitters: Mapping[str, complex]
    receivers: Mapping[str, complex]
    slots: Mapping[str, complex]
    min_separation_m: float = 5.0
    speed_mps: float = 5.0
    stop_s: float = 3.0
    objective: Objective = "length"
    bearing_sigma_rad: float = math.radians(0.5)
    """Noise of one bearing sample."""
    samples: int = 10
    """Independent samples averaged in one bearing (k)."""
    start_sigma_m: float = 1.0
    """Error of a receiver's located start, per axis."""
    heading_referenced: bool = False
    """Whether bearings are north-referenced; otherwise only differences of bearings are known."""
    tolerance_3sigma_m: float | None = None
    """Largest predicted placement error along its worst axis, three sigma; None: no limit."""
    map_trim: bool = False
    """Whether every placement is followed by the maximum-a-posteriori trim leg, and predicted with it."""
    max_leg_m: float | None = None
    fence: tuple[complex, ...] = ()
    """Corners of the polygon no leg may leave; empty: no fence."""
    obstacles: Mapping[str, complex] = field(default_factory=dict)
    """What else stands in the air and is kept at the separation."""
    ground_transmitters: frozenset[str] = frozenset()
    """Transmitters that are beacons on the ground: flown over, no separation."""

    def __post_init__(self) -> None:
        if len(self.transmitters) < 2:
            raise ProblemError(
                f"the relay needs two transmitters from the start, not {len(self.transmitters)}: "
                "a stop condition is the angle between two"
            )
        if not self.receivers:
            raise ProblemError("the relay needs at least one receiver")
        if not self.slots:
            raise ProblemError("the relay needs at least one slot")
        for kind, points in (("transmitter", self.transmitters), ("receiver", self.receivers), ("slot", self.slots)):
            _require_apart(kind, points)
        _require_finite("obstacle", self.obstacles)
        _require_finite("fence corner", {str(k): corner for k, corner in enumerate(self.fence)})
        if shared := self.transmitters.keys() & self.receivers.keys():
            raise ProblemError(f"{', '.join(sorted(shared))}: a UAV is either a transmitter or a receiver at the start")
        if unknown := self.ground_transmitters - self.transmitters.keys():
            raise ProblemError(f"{', '.join(sorted(unknown))}: a ground transmitter must be one of the transmitters")
        if self.objective not in get_args(Objective):
            raise ProblemError(f"objective is {self.objective!r}: it must be one of {', '.join(get_args(Objective))}")
        if 0 < len(self.fence) < 3:
            raise ProblemError(f"a fence needs three corners, not {len(self.fence)}")
        self._require_numbers()

    def _require_numbers(self) -> None:
        for name, value, least in (
            ("min_separation_m", self.min_separation_m, 0.0),
            ("stop_s", self.stop_s, 0.0),
            ("speed_mps", self.speed_mps, 1e-6),
            ("bearing_sigma_rad", self.bearing_sigma_rad, 0.0),
            ("samples", self.samples, 1),
            ("start_sigma_m", self.start_sigma_m, 0.0),
            ("tolerance_3sigma_m", self.tolerance_3sigma_m, 0.0),
            ("max_leg_m", self.max_leg_m, 0.0),
        ):
            if value is not None and not least <= value < math.inf:
                raise ProblemError(f"{name} is {value}: it must be a finite number of at least {least:g}")


def _require_finite(kind: str, points: Mapping[str, complex]) -> None:
    for name, point in points.items():
        if not cmath.isfinite(point):
            raise ProblemError(f"{kind} {name} lies at {point}: coordinates must be finite")


def _require_apart(kind: str, points: Mapping[str, complex]) -> None:
    _require_finite(kind, points)
    names: dict[complex, str] = {}
    for name, point in points.items():
        if (other := names.setdefault(point, name)) != name:
            raise ProblemError(f"{kind}s {other} and {name} lie at the same place {point}")


def makespan_s(problem: RelayProblem, routes: Sequence[Route]) -> float:
    """Return the time the relay takes, s: the waves one after another, each as long as its longest route."""
    return sum(wave_durations_s(problem, routes).values())


def emission_transmitter_s(problem: RelayProblem, routes: Sequence[Route]) -> float:
    """Return the transmitter-seconds of the relay: in each wave the transmitters its routes need are on the air."""
    durations_s = wave_durations_s(problem, routes)
    on_air: dict[int, set[str]] = {}
    for route in routes:
        on_air.setdefault(route.wave, set()).update(route.transmitters)
    return sum(durations_s[wave] * len(names) for wave, names in on_air.items())


def wave_durations_s(problem: RelayProblem, routes: Sequence[Route]) -> dict[int, float]:
    """Return how long each wave takes, s: its longest route at the problem's speed, plus one stop for every leg."""
    durations_s: dict[int, float] = {}
    for route in routes:
        flown_s = route.length_m / problem.speed_mps + len(route.legs) * problem.stop_s
        durations_s[route.wave] = max(durations_s.get(route.wave, 0.0), flown_s)
    return durations_s
