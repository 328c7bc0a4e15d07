"""What a check before flight finds: values, and the checks of parameters that an autopilot's strategy lists."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """What a check comes to. Nothing is armed on a hard failure; a soft one is for the operator to judge."""

    RUNNING = "running"
    PASSED = "passed"
    SOFT = "soft"
    HARD = "hard"


@dataclass(frozen=True)
class Finding:
    """What was found, and where that is not as it should be, the way out."""

    verdict: Verdict
    found: str
    way_out: str = ""


def passed(found: str) -> Finding:
    """Return that all is as it should be."""
    return Finding(Verdict.PASSED, found)


def soft(found: str, way_out: str) -> Finding:
    """Return what the operator should know and may accept."""
    return Finding(Verdict.SOFT, found, way_out)


def hard(found: str, way_out: str) -> Finding:
    """Return what nothing may be armed with."""
    return Finding(Verdict.HARD, found, way_out)


@dataclass(frozen=True)
class Check:
    """One check of one vehicle."""

    vehicle: str
    name: str
    verdict: Verdict
    found: str
    way_out: str = ""
    link: str = ""
    """Over which the vehicle was spoken to."""

    @classmethod
    def of(cls, vehicle: str, name: str, finding: Finding) -> Check:
        """Return a finding with where it belongs."""
        return cls(vehicle, name, finding.verdict, finding.found, finding.way_out)


@dataclass(frozen=True)
class Intent:
    """What is going to be asked of a vehicle, and by whom."""

    altitude_m: float
    """Above home."""
    speed_mps: float
    reach_m: float
    """How far from home, horizontally, its route leads it."""
    station_system_id: int


Parameters = Mapping[str, float]
"""An autopilot's parameters by name, as far as it told them."""


@dataclass(frozen=True)
class ParameterCheck:
    """One check of an autopilot's parameters: those it reads, and what their values mean for a flight."""

    name: str
    reads: tuple[str, ...]
    judge: Callable[[Parameters, Intent], Finding]


def unread(name: str) -> Finding:
    """Return that a parameter without which nothing can be judged was not told."""
    return soft(f"{name} was not told", "Check that the autopilot has this parameter, and the link.")
