"""Wrong tokens, counted by where they come from: whoever gives too many waits; nobody else does."""

from __future__ import annotations

import ipaddress
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from drivers.clock import Clock

ALLOWED: Final = 5
WITHIN_S: Final = 60.0
_ADDRESSES_KEPT: Final = 1000


@dataclass
class Attempts:
    """The wrong tokens of late, of each address; a whole /64 counts as one, for one machine has all of it."""

    clock: Clock
    _failed_s: dict[str, deque[float]] = field(default_factory=dict)

    def wait_s(self, address: str) -> float:
        """Return how long until an address may try again, s; 0 when it may now."""
        failed_s = self._failed_s.get(_origin(address), deque())
        if len(failed_s) < ALLOWED:
            return 0.0
        return max(0.0, failed_s[0] + WITHIN_S - self.clock.now_s())

    def failed(self, address: str) -> None:
        """Note a wrong token."""
        origin = _origin(address)
        failed_s = self._failed_s.pop(origin, deque(maxlen=ALLOWED))
        failed_s.append(self.clock.now_s())
        self._failed_s[origin] = failed_s
        if len(self._failed_s) > _ADDRESSES_KEPT:
            del self._failed_s[next(iter(self._failed_s))]


def _origin(address: str) -> str:
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address
    if isinstance(parsed, ipaddress.IPv6Address):
        return str(ipaddress.ip_network((parsed, 64), strict=False))
    return str(parsed)
