"""One way of a radio between the service and a vehicle: what is sent gets lost, doubled, late or overtaken."""

from __future__ import annotations

import heapq
import random
from collections.abc import Iterator
from itertools import count
from typing import Generic, TypeVar

from drivers.simulation.impairment import UNIMPAIRED

Sent = TypeVar("Sent")


class Radio(Generic[Sent]):
    """What is in the air, by when it arrives; at first everything does at once."""

    def __init__(self, seed: str) -> None:
        self.impairment = UNIMPAIRED
        self._draws = random.Random(f"{seed}/radio")  # noqa: S311 - noise, not secrets
        self._numbers = count()
        self._in_the_air: list[tuple[float, int, Sent]] = []

    def send(self, now_s: float, sent: Sent) -> None:
        """Send something now."""
        for after_s in self.impairment.arrivals_s(self._draws):
            heapq.heappush(self._in_the_air, (now_s + after_s, next(self._numbers), sent))

    def arrived(self, now_s: float) -> Iterator[tuple[float, Sent]]:
        """Yield what has arrived by now, and when."""
        while self._in_the_air and self._in_the_air[0][0] <= now_s:
            at_s, _, sent = heapq.heappop(self._in_the_air)
            yield at_s, sent
