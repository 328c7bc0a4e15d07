"""Whether what stop monitors took in was said on the bus: each report of theirs is looked for among the recorded."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Mapping

from drivers.bus.messages import BearingReport
from gcs.traced_monitor import Observed
from planner.angles import wrap
from planner.frames import FormationFrame


class BusAudit:
    """Compares to the last bit. The order does not matter: the two are recorded independently."""

    def __init__(self, frame: FormationFrame) -> None:
        self._frame = frame
        self._said: set[tuple[str, int]] = set()
        self._taken: Counter[tuple[str, int]] = Counter()

    def said(self, receiver: str, report: BearingReport) -> None:
        """Note a report on the bus."""
        directed = self._frame.azimuth_rad if report.reference == "true_north" else operator.neg
        directions_rad = {b.transmitter: wrap(directed(b.azimuth_rad)) for b in report.bearings}
        self._said.add((receiver, _print(directions_rad, {b.transmitter: b.sigma_rad for b in report.bearings})))

    def taken(self, receiver: str, observed: Observed) -> None:
        """Note what a monitor was told."""
        self._taken[receiver, _print(observed.directions_rad, observed.sigma_rad)] += 1

    @property
    def unsaid(self) -> int:
        """How many reports monitors took in that the recorded bus does not hold."""
        return sum(count for seen, count in self._taken.items() if seen not in self._said)


def _print(directions_rad: Mapping[str, float], sigma_rad: Mapping[str, float]) -> int:
    return hash(tuple((name, direction, sigma_rad.get(name)) for name, direction in directions_rad.items()))
