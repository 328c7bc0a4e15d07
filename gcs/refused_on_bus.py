"""What the routers of a closed bus refuse while a run lasts: taken off the bus, said to the operator, reported."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final

from drivers.bus.refusals import Refusals, decode_refusals, refusals_key
from drivers.bus.session import Bus
from drivers.clock import Clock
from drivers.strict_json import MalformedError

SAID_EVERY_S: Final = 10.0
_MOST_ROUTERS: Final = 64


class RefusedOnBus:
    """What routers refused since each of them began, which may be before the run.

    `say` is told whenever it has grown, once in SAID_EVERY_S at the most.
    """

    def __init__(self, clock: Clock, say: Callable[[str], None]) -> None:
        self.unreadable = 0
        self._clock = clock
        self._say = say
        self._routers: OrderedDict[str, Refusals] = OrderedDict()
        """What each router told last, by its key: another one for each life of it."""
        self._earlier = Refusals()
        """Of routers that have not been heard for long."""
        self._said_s = -math.inf
        self._said = 0

    @property
    def total(self) -> Refusals:
        """What all routers together refused."""
        return sum(self._routers.values(), self._earlier)

    def attach(self, bus: Bus, swarm: str) -> None:
        """Take what the routers of a swarm tell off the bus."""
        bus.subscribe(refusals_key(swarm), self.take)

    def take(self, key: str, payload: bytes) -> None:
        """Take what one router tells as it comes off the bus."""
        try:
            self._routers[key] = decode_refusals(payload)
        except MalformedError:
            self.unreadable += 1
            return
        self._routers.move_to_end(key)
        if len(self._routers) > _MOST_ROUTERS:
            self._earlier += self._routers.popitem(last=False)[1]
        total, now_s = self.total, self._clock.now_s()
        if total.total > self._said and now_s - self._said_s >= SAID_EVERY_S:
            self._said, self._said_s = total.total, now_s
            self._say(str(total))

    def alert(self) -> str | None:
        """Return what the operator should know for as long as the run lasts, or None."""
        total = self.total
        return str(total) if total.total else None

    def report(self) -> dict[str, Any]:
        """Return what report.json says of it."""
        total = self.total
        return {name: getattr(total, name) for name in Refusals.__struct_fields__}
