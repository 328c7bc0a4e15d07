"""What one receiver's reports were worth when they were delivered, by the truth about when they were captured."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Final

from drivers.bus.messages import BearingReport
from planner.angles import direction, wrap

_LATER_S: Final = 0.05
"""What a capture time may be off by, of a sensor whose clock was asked a second ago."""
_NEVER_S: Final = float("-inf")
_SURE_SIGMAS: Final = 4.0
_BY_CHANCE: Final = 1


@dataclass
class Hearing:
    """The reports of one receiver. Fresh is one that is young, newer than all before, and says something new.

    The same once more may be chance, and twice is none.
    """

    oldest_s: float
    """What a fresh report's age may be, s."""
    fresh_s: float = _NEVER_S
    """When the last fresh report was delivered."""
    azimuths_rad: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    """What fresh reports have said of each transmitter since somebody cleared it."""
    _newest_captured_s: float = _NEVER_S
    _last: dict[str, float] = field(default_factory=dict)
    _repeats: int = 0

    def take(self, now_s: float, captured_s: float, report: BearingReport) -> None:
        """Take a report that is delivered now and was truly captured then."""
        heard = {bearing.transmitter: bearing.azimuth_rad for bearing in report.bearings}
        self._repeats = self._repeats + 1 if heard == self._last else 0
        newer, news = captured_s > self._newest_captured_s, self._repeats <= _BY_CHANCE
        self._newest_captured_s = max(self._newest_captured_s, captured_s)
        if not (heard and newer and news and now_s - captured_s <= self.oldest_s + _LATER_S):
            return
        self._last, self.fresh_s = heard, now_s
        for name, azimuth_rad in heard.items():
            self.azimuths_rad[name].append(azimuth_rad)

    def farthest_off_m(
        self, place: complex, transmitters: Mapping[str, complex], sigma_rad: float
    ) -> tuple[float, str] | None:
        """Return how far bearings from north surely pass by a place, site frame, m, and whose do so most.

        None where nothing was heard of these transmitters.
        """
        off_m: list[tuple[float, str]] = []
        for name, azimuths_rad in self.azimuths_rad.items():
            if name not in transmitters:
                continue
            sight = transmitters[name] - place
            off_rad = abs(median(wrap(azimuth_rad - direction(sight)) for azimuth_rad in azimuths_rad))
            sure_rad = max(0.0, off_rad - _SURE_SIGMAS * sigma_rad / math.sqrt(len(azimuths_rad)))
            off_m.append((abs(sight) * sure_rad, name))
        return max(off_m, default=None)
