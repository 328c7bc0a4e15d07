"""The relay problem, and what an order of routes costs in time and emission."""

from __future__ import annotations

import cmath
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from planner.errors import ProblemError
from planner.plan import Route


@dataclass(frozen=True)
class RelayProblem:
    """What is to be planned: who transmits from the start, who receives and from where, and which slots to fill.

    Points are in the formation frame, m; mappings keep their order, and slots come in relay order. Raises ProblemError
    when it is no problem that could be planned.
    """

    transmitters: Mapping[str, complex]
    receivers: Mapping[str, complex]
    slots: Mapping[str, complex]
    min_separation_m: float = 5.0
    speed_mps: float = 5.0
    stop_s: float = 3.0

    def __post_init__(self) -> None:
        if len(self.transmitters) < 2:
            raise ProblemError(
                f"the relay needs two transmitters from the start, not {len(self.transmitters)}: "
                "a stop condition is the angle between two"
            )
        if not self.receivers:
            raise ProblemError("the relay needs at least one receiver")
        if len(self.receivers) > len(self.slots):
            raise ProblemError(
                f"{len(self.receivers)} receivers but only {len(self.slots)} slots: add slots or take UAVs out"
            )
        for kind, points in (("transmitter", self.transmitters), ("receiver", self.receivers), ("slot", self.slots)):
            _require_apart(kind, points)
        if shared := self.transmitters.keys() & self.receivers.keys():
            raise ProblemError(f"{', '.join(sorted(shared))}: a UAV is either a transmitter or a receiver at the start")
        for name, value, least in (
            ("min_separation_m", self.min_separation_m, 0.0),
            ("stop_s", self.stop_s, 0.0),
            ("speed_mps", self.speed_mps, 1e-6),
        ):
            if not least <= value < float("inf"):
                raise ProblemError(f"{name} is {value}: it must be a finite number of at least {least:g}")


def _require_apart(kind: str, points: Mapping[str, complex]) -> None:
    for name, point in points.items():
        if not cmath.isfinite(point):
            raise ProblemError(f"{kind} {name} lies at {point}: coordinates must be finite")
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
