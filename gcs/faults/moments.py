"""When each fault of a run begins and ends: so long after a receiver has first come into a state, and for so long."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from gcs.faults.fault import Fault, Kind

OF_THE_SERVICE: Final[frozenset[Kind]] = frozenset({"service_stopped", "service_killed"})
"""These befall the service, as long as it runs; they end by themselves."""


@dataclass
class Moments:
    """The faults of one run, and which of them have struck."""

    faults: Sequence[Fault]
    struck: dict[int, float] = field(default_factory=dict)
    """When each fault that has struck did so, by its number."""
    _entered_s: dict[tuple[str, str], float] = field(default_factory=dict)
    _mended: set[int] = field(default_factory=set)

    def entered(self, receiver: str, state: str, now_s: float) -> None:
        """Note that a receiver has come into a state; only the first time counts."""
        self._entered_s.setdefault((receiver, state), now_s)

    def due(self, now_s: float, *, ended: bool) -> Iterator[tuple[Fault, bool]]:
        """Yield the faults that begin now (True), or end. `ended`: the service runs no more."""
        for number, fault in enumerate(self.faults):
            entered_s = self._entered_s.get((fault.at.receiver, fault.at.state))
            if entered_s is None or number in self._mended or (ended and fault.kind in OF_THE_SERVICE):
                continue
            if number not in self.struck:
                if now_s >= entered_s + fault.at.after_s:
                    self.struck[number] = now_s
                    yield fault, True
            elif fault.for_s is not None and now_s >= self.struck[number] + fault.for_s:
                self._mended.add(number)
                if fault.kind not in OF_THE_SERVICE:
                    yield fault, False

    def astray(self) -> set[str]:
        """Return who has drifted, or drifts."""
        struck = (self.faults[number] for number in self.struck)
        return {fault.target for fault in struck if fault.kind == "transmitter_drift"}
