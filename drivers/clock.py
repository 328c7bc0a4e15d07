"""The clock every timed component is handed, so that tests never sleep and simulations may run fast."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass
from typing import Protocol


class Clock(Protocol):
    """Time as the flight sees it."""

    def now_s(self) -> float:
        """Return monotonic time, s; only differences mean anything."""
        ...

    def unix_ns(self) -> int:
        """Return time since 1970-01-01 UTC, ns: the capture times on the bus."""
        ...

    async def sleep(self, duration_s: float) -> None:
        """Return after `duration_s` of this clock's time, s."""
        ...


@dataclass(frozen=True)
class SystemClock:
    """The machine's clock, or that clock run `speedup` times as fast from `epoch_ns` on.

    Processes given the same `speedup` and `epoch_ns` share one simulated time.
    """

    speedup: float = 1.0
    epoch_ns: int = 0

    def now_s(self) -> float:
        """Return monotonic time, s."""
        return time.monotonic() * self.speedup

    def unix_ns(self) -> int:
        """Return (simulated) time since 1970-01-01 UTC, ns."""
        wall_ns = time.time_ns()
        if self.speedup == 1.0:
            return wall_ns
        return self.epoch_ns + round((wall_ns - self.epoch_ns) * self.speedup)

    async def sleep(self, duration_s: float) -> None:
        """Return after `duration_s` of (simulated) time, s."""
        await asyncio.sleep(max(0.0, duration_s) / self.speedup)
