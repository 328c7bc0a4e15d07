"""Who is on the air: every receiver names the transmitters it needs; the union emits, and the ledger counts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Emission, encode
from drivers.bus.session import Bus
from drivers.clock import Clock

LOOK_S: Final = 0.5
BACK_S: Final = 5.0
"""After an outage everybody has joined the bus again within this: each looks for the router in its own time."""


@dataclass
class EmissionControl:
    """Switches transmitters and counts for how long each was on."""

    bus: Bus
    keys: SwarmKeys
    clock: Clock
    _needed_by: dict[str, frozenset[str]] = field(default_factory=dict)
    _on_since_s: dict[str, float] = field(default_factory=dict)
    _ended_s: float = 0.0
    _told: dict[str, bool] = field(default_factory=dict)

    @property
    def on_air(self) -> frozenset[str]:
        """The transmitters that are on."""
        return frozenset(self._on_since_s)

    def need(self, receiver: str, transmitters: Collection[str]) -> None:
        """Keep exactly these transmitters on for a receiver, and nobody on that no receiver needs; none: it is done."""
        self._needed_by[receiver] = frozenset(transmitters)
        wanted = frozenset().union(*self._needed_by.values())
        now_s = self.clock.now_s()
        for name in sorted(self._on_since_s.keys() - wanted):
            self._ended_s += now_s - self._on_since_s.pop(name)
            self._tell(name, on=False)
        for name in sorted(wanted - self._on_since_s.keys()):
            self._on_since_s[name] = now_s
            self._tell(name, on=True)

    def transmitter_s(self) -> float:
        """Return the transmitter-seconds up to now."""
        now_s = self.clock.now_s()
        return self._ended_s + sum(now_s - since_s for since_s in self._on_since_s.values())

    async def run(self) -> None:
        """Tell everybody again, whenever the bus is back, what holds: what was told while it was gone got lost."""
        gone, until_s = False, self.clock.now_s()
        while True:
            await self.clock.sleep(LOOK_S)
            if not self.bus.connected():
                gone = True
                continue
            if gone:
                gone, until_s = False, self.clock.now_s() + BACK_S
            if self.clock.now_s() < until_s:
                for name, on in self._told.items():
                    self._tell(name, on=on)

    def _tell(self, name: str, *, on: bool) -> None:
        self._told[name] = on
        self.bus.put_reliably(self.keys.emission(name), encode(Emission(on=on)))
