"""Who is on the air: emission commands over the bus, and the ledger of transmitter-seconds."""

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
    _on_since_s: dict[str, float] = field(default_factory=dict)
    _ended_s: float = 0.0

    @property
    def on_air(self) -> frozenset[str]:
        """The transmitters that are on."""
        return frozenset(self._on_since_s)

    def set_on_air(self, names: Collection[str]) -> None:
        """Switch exactly these transmitters on, and every other one off."""
        now_s = self.clock.now_s()
        for name in sorted(self._on_since_s.keys() - set(names)):
            self._ended_s += now_s - self._on_since_s.pop(name)
            self.bus.put_reliably(self.keys.emission(name), encode(Emission(on=False)))
        for name in sorted(set(names) - self._on_since_s.keys()):
            self._on_since_s[name] = now_s
            self.bus.put_reliably(self.keys.emission(name), encode(Emission(on=True)))

    def transmitter_s(self) -> float:
        """Return the transmitter-seconds up to now."""
        now_s = self.clock.now_s()
        return self._ended_s + sum(now_s - since_s for since_s in self._on_since_s.values())
