"""A node's tenure: which vehicles it may move, and until when, by the grants that answer its own beats.

A grant counts from the moment the beat was made that it answers, by the node's own clock: no clocks are compared, and
a grant that was held up on its way is worth only what is left of it. When it has run out, the vehicle is stopped, and
soon after nothing at all is sent to it any more: then another node may have it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from drivers.mavlink.setpoints import ZERO_REPEATED_S
from gcs.nodes.messages import Grant, VehicleGrant

BEAT_S: Final = 0.2
"""How often a node says that it lives."""
YIELD_S: Final = ZERO_REPEATED_S + 0.2
"""How long a vehicle is stopped whose grant has run out, until it is let go."""


class Authority(Enum):
    """What a node may send to a vehicle now."""

    GRANTED = "granted"
    STOPPING = "stopping"
    """Zero velocity, and no more."""
    NONE = "none"


@dataclass
class Holding:
    """One vehicle of a tenure."""

    token: int
    grant_s: float
    granted: VehicleGrant
    until_s: float = float("-inf")
    """When its grant runs out, by the node's clock."""
    number: int = -1

    @property
    def silent_from_s(self) -> float:
        """When nothing may be sent to it any more."""
        return self.until_s + YIELD_S


@dataclass
class Tenure:
    """What one node has been given. `life` is its own: grants for beats of an earlier one are none."""

    life: int
    refused: Counter[str] = field(default_factory=Counter)
    """How much was said by whoever has no right to, or too late, by why."""
    highest: dict[str, int] = field(default_factory=dict)
    """The highest token seen for each vehicle."""
    holdings: dict[str, Holding] = field(default_factory=dict)

    def assign(self, vehicle: str, token: int, grant_s: float) -> bool:
        """Hold a vehicle by a new token; False when it is held by it already, or the token is older than the highest.

        Nothing may be sent to it before a grant names it.
        """
        held = self.holdings.get(vehicle)
        if held is not None and held.token == token:
            return False
        if not self._current(vehicle, token):
            return False
        self.holdings[vehicle] = Holding(token, grant_s, VehicleGrant(token))
        return True

    def take(self, grant: Grant, now_s: float) -> list[str]:
        """Take a grant in and return the vehicles that are to be stopped by it."""
        if grant.life != self.life or grant.stamp_ns > round(now_s * 1e9):
            self.refused["grant for another life"] += 1
            return []
        stopped = []
        for vehicle, own in grant.vehicles.items():
            held = self.holdings.get(vehicle)
            if not self._current(vehicle, own.token) or held is None or held.token != own.token:
                continue
            held.until_s = max(held.until_s, grant.stamp_ns * 1e-9 + held.grant_s)
            if own.stops > held.granted.stops:
                stopped.append(vehicle)
            if grant.number > held.number:
                held.number, held.granted = grant.number, own
        return stopped

    def obeys(self, vehicle: str, token: int, now_s: float) -> str | None:
        """Return why an order with this token is not carried out, or None; each refusal is counted."""
        held = self.holdings.get(vehicle)
        if not self._current(vehicle, token):
            return f"{vehicle} has been given on: the token is older than the highest seen"
        if held is None or held.token != token:
            self.refused["not assigned"] += 1
            return f"{vehicle} is not held here"
        if self.authority(vehicle, now_s) is not Authority.GRANTED:
            self.refused["not granted"] += 1
            return f"the grant for {vehicle} has run out"
        return None

    def authority(self, vehicle: str, now_s: float) -> Authority:
        """Return what may be sent to a vehicle now."""
        held = self.holdings.get(vehicle)
        if held is None or now_s >= held.silent_from_s:
            return Authority.NONE
        return Authority.GRANTED if now_s < held.until_s else Authority.STOPPING

    def leave(self, vehicle: str) -> None:
        """Hold a vehicle no longer; a token seen for it stays seen."""
        self.holdings.pop(vehicle, None)

    def _current(self, vehicle: str, token: int) -> bool:
        if token < self.highest.get(vehicle, 0):
            self.refused["old token"] += 1
            return False
        self.highest[vehicle] = token
        return True
