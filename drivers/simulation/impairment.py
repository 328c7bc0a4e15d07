"""What a bad radio does to each packet: it loses it, repeats it, delays it, lets others overtake it."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Final

_OVERTAKEN_S: Final = (0.12, 0.4)
_AGAIN_S: Final = (0.0, 0.6)


@dataclass(frozen=True)
class Impairment:
    """Shares of the packets, 0 to 1, and times, s. `jitter_s` is the most that is added to the delay."""

    loss: float = 0.0
    duplication: float = 0.0
    reordering: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0

    def arrivals_s(self, draws: random.Random) -> list[float]:
        """Return after how long each copy of one packet arrives; none when it gets lost."""
        if draws.random() < self.loss:
            return []
        arrivals_s = [self._delay_s(draws)]
        if draws.random() < self.duplication:
            arrivals_s.append(self._delay_s(draws) + draws.uniform(*_AGAIN_S))
        return arrivals_s

    def _delay_s(self, draws: random.Random) -> float:
        delay_s = self.delay_s + draws.uniform(0.0, self.jitter_s)
        return delay_s + draws.uniform(*_OVERTAKEN_S) if draws.random() < self.reordering else delay_s


UNIMPAIRED: Final = Impairment()
"""Everything arrives at once."""
