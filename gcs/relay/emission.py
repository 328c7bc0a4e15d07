"""Who is on the air: every receiver names the transmitters it needs; the union emits, and the ledger counts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Emission, encode
from drivers.bus.session import Bus
from drivers.clock import Clock


@dataclass
class EmissionControl:
    """Switches transmitters and counts for how long each was on."""

    bus: Bus
    keys: SwarmKeys
    clock: Clock
    _needed_by: dict[str, frozenset[str]] = field(default_factory=dict)
    _on_since_s: dict[str, float] = field(default_factory=dict)
    _ended_s: float = 0.0

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
            self.bus.put_reliably(self.keys.emission(name), encode(Emission(on=False)))
        for name in sorted(wanted - self._on_since_s.keys()):
            self._on_since_s[name] = now_s
            self.bus.put_reliably(self.keys.emission(name), encode(Emission(on=True)))

    def transmitter_s(self) -> float:
        """Return the transmitter-seconds up to now."""
        now_s = self.clock.now_s()
        return self._ended_s + sum(now_s - since_s for since_s in self._on_since_s.values())
