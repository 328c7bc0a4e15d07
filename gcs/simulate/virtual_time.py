"""Virtual time: an event loop whose clock jumps to the next thing due instead of waiting for it."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any, Final, TypeVar

EPOCH_NS: Final = 1_800_000_000_000_000_000
"""What a virtual clock shows as the time since 1970 when it starts, ns."""

Result = TypeVar("Result")


class _Jump(selectors.DefaultSelector):
    """A selector that never waits: the time it was to wait has passed when it returns."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0.0)
        if not ready:
            if timeout is None:
                raise RuntimeError("nothing is due any more: everybody waits for somebody else")
            self.now_s += max(timeout, 0.0)
        return ready


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An event loop in virtual time, which begins at zero."""

    def __init__(self) -> None:
        self._jump = _Jump()
        super().__init__(self._jump)

    def time(self) -> float:
        """Return the virtual time, s."""
        return self._jump.now_s

    def stall(self, duration_s: float) -> None:
        """Let time pass in which nothing runs that waits in this loop, as in a process that is stopped."""
        self._jump.now_s += duration_s


class VirtualClock:
    """The clock of the virtual loop it is used in."""

    def now_s(self) -> float:
        """Return monotonic time, s."""
        return asyncio.get_running_loop().time()

    def unix_ns(self) -> int:
        """Return time since 1970-01-01 UTC, ns."""
        return EPOCH_NS + round(self.now_s() * 1e9)

    async def sleep(self, duration_s: float) -> None:
        """Return after `duration_s` of virtual time, s."""
        await asyncio.sleep(max(0.0, duration_s))


def run_virtually(coroutine: Coroutine[Any, Any, Result]) -> Result:
    """Run a coroutine to its end in virtual time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(coroutine)
