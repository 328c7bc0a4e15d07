"""What is found against a run: which invariant did not hold, when, of which vehicle."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal, get_args

import msgspec

Invariant = Literal[
    "fresh_bearing",
    "pilot",
    "separation",
    "leg_time",
    "leg_length",
    "stopped",
    "followed",
    "placement",
    "ended",
    "recorded",
    "exception",
]
INVARIANTS: Final[tuple[Invariant, ...]] = get_args(Invariant)


class Finding(msgspec.Struct, frozen=True):
    """An invariant that did not hold, for the first time of this vehicle."""

    invariant: Invariant
    vehicle: str
    time_s: float
    what: str


@dataclass
class Findings:
    """The findings of one run, the first of each invariant and vehicle, in the order of time."""

    all: list[Finding] = field(default_factory=list)
    _found: set[tuple[Invariant, str]] = field(default_factory=set)

    def add(self, invariant: Invariant, vehicle: str, time_s: float, what: str) -> None:
        """Note that an invariant did not hold."""
        if (invariant, vehicle) not in self._found:
            self._found.add((invariant, vehicle))
            self.all.append(Finding(invariant, vehicle, round(time_s, 3), what))
