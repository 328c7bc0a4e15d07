"""A bus within one process that loses, doubles and cuts off."""

from __future__ import annotations

import heapq
import random
from itertools import count
from typing import Final

from drivers.bus.keys import uav_of
from drivers.clock import Clock
from gcs.simulate.bus import LocalBus

_AGAIN_S: Final = (0.0, 0.6)
_REPORTS: Final = ("bearings", "clock_ping", "clock_pong")


class FaultyBus(LocalBus):
    """A bus whose router may be gone; of some UAVs' reports and clock answers it loses or repeats a share.

    What was put reliably while it was gone is delivered when it is back.
    """

    def __init__(self, clock: Clock, seed: int) -> None:
        super().__init__()
        self.lost_share: dict[str, float] = {}
        self.repeated_share: dict[str, float] = {}
        self._clock = clock
        self._draws = random.Random(f"{seed}/bus")  # noqa: S311 - noise, not secrets
        self._gone = False
        self._missed: dict[str, bytes] = {}
        self._again: list[tuple[float, int, str, bytes]] = []
        self._numbers = count()

    def connected(self) -> bool:
        """Return whether its router is there."""
        return not self._gone

    def go(self) -> None:
        """Lose the router."""
        self._gone = True

    def come_back(self) -> None:
        """Have the router again, and deliver what counts."""
        self._gone = False
        missed, self._missed = self._missed, {}
        for key, payload in missed.items():
            super().put_latest(key, payload)

    def put_latest(self, key: str, payload: bytes, *, urgent: bool = False) -> None:
        """Deliver a value, unless it gets lost; perhaps it comes once more later."""
        name = uav_of(key)
        if self._gone:
            return
        if name is not None and key.endswith(_REPORTS):
            if self._draws.random() < self.lost_share.get(name, 0.0):
                return
            if self._draws.random() < self.repeated_share.get(name, 0.0):
                due_s = self._clock.now_s() + self._draws.uniform(*_AGAIN_S)
                heapq.heappush(self._again, (due_s, next(self._numbers), key, payload))
        super().put_latest(key, payload, urgent=urgent)

    def put_reliably(self, key: str, payload: bytes) -> None:
        """Deliver a value, now or when the router is back."""
        if self._gone:
            self._missed[key] = payload
        super().put_reliably(key, payload)

    def repeat(self) -> None:
        """Deliver once more what is due."""
        while self._again and self._again[0][0] <= self._clock.now_s():
            *_, key, payload = heapq.heappop(self._again)
            if not self._gone:
                super().put_latest(key, payload)
