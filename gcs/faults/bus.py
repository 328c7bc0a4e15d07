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
_APART_S: Final = (0.0, 4.0)
"""Every process looks for a new router in its own time, and as seldom as every 4 s when it was gone for long."""
_REPORTS: Final = ("bearings", "clock_ping", "clock_pong")


class FaultyBus(LocalBus):
    """A bus whose router may be gone; of some UAVs' reports and clock answers it loses or repeats a share.

    What was put reliably while it was gone is delivered when it is back. A new router in its place knows nothing: the
    service is back first, nobody hears anybody, and only later whoever joins asks for what was put reliably.
    """

    def __init__(self, clock: Clock, seed: int) -> None:
        super().__init__()
        self.lost_share: dict[str, float] = {}
        self.repeated_share: dict[str, float] = {}
        self._clock = clock
        self._draws = random.Random(f"{seed}/bus")  # noqa: S311 - noise, not secrets
        self._gone = False
        self._apart_until_s = float("-inf")
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
        self._catch_up()

    def start_anew(self) -> None:
        """Have another router, which the others are not connected to yet."""
        self._gone = False
        self._apart_until_s = self._clock.now_s() + self._draws.uniform(*_APART_S)

    def put_latest(self, key: str, payload: bytes, *, urgent: bool = False) -> None:
        """Deliver a value, unless it gets lost; perhaps it comes once more later."""
        name = uav_of(key)
        if self._away():
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
        if self._away():
            self._missed[key] = payload
        super().put_reliably(key, payload)

    def repeat(self) -> None:
        """Deliver once more what is due, and what counts to those who are back."""
        self._catch_up()
        while self._again and self._again[0][0] <= self._clock.now_s():
            *_, key, payload = heapq.heappop(self._again)
            if not self._away():
                super().put_latest(key, payload)

    def _away(self) -> bool:
        return self._gone or self._clock.now_s() < self._apart_until_s

    def _catch_up(self) -> None:
        if self._missed and not self._away():
            missed, self._missed = self._missed, {}
            for key, payload in missed.items():
                super().put_latest(key, payload)
