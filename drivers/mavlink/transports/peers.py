"""Who is behind one listening UDP socket: the address each autopilot is answered at, and who else spoke.

A system is answered where its autopilot's heartbeats come from, and only there: what claims to be the same autopilot
from elsewhere is refused until the first has been silent for some seconds. Neither a stray datagram nor a second
vehicle with the same system id can then divert setpoints, or mix its telemetry in.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Source = tuple[str, int] | tuple[str, int, int, int]
"""What a UDP socket calls an address: host and port, and with IPv6 two numbers more."""

STICKS_S: Final = 3.0
"""An autopilot silent for longer may speak from another address."""
CONTESTED_S: Final = 10.0
MOST_BYSTANDERS: Final = 16
"""Peers without an autopilot that get what is for all; the autopilots' own are bounded by their 255 system ids."""

_LENGTH, _SYSTEM, _COMPONENT, _MESSAGE = 1, 5, 6, slice(7, 10)
_HEARTBEAT: Final = b"\0\0\0"
_AUTOPILOT_AT: Final = 5
"""Where a heartbeat's payload says which autopilot; zeros at a payload's end are left out."""


@dataclass
class _Route:
    source: Source
    heard_s: float
    rival_s: float = -math.inf
    contested_s: float = -math.inf


class Peers:
    """The addresses behind one socket. Times are of any one monotonic clock, s."""

    def __init__(self) -> None:
        self._routes: dict[int, _Route] = {}
        self._bystanders: dict[Source, None] = {}
        self._everybody: dict[Source, None] = {}

    def admits(self, frame: bytearray, source: Source, now_s: float) -> bool:
        """Return False for a frame of an autopilot that is being heard from another address."""
        if frame[_COMPONENT] != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return True
        route = self._routes.get(frame[_SYSTEM])
        if route is None or route.source == source or now_s - route.heard_s > STICKS_S:
            return True
        route.rival_s = now_s
        return False

    def heard(self, frame: bytearray, source: Source, now_s: float) -> None:
        """Learn from a frame that was admitted and accepted."""
        route = self._routes.get(frame[_SYSTEM])
        if frame[_COMPONENT] == mavlink.MAV_COMP_ID_AUTOPILOT1:
            if route is not None and route.source == source:
                route.heard_s = now_s
                if now_s - route.rival_s < STICKS_S:
                    route.contested_s = now_s  # both are alive: no vehicle that has only moved to another address
                return
            if _is_autopilots_heartbeat(frame):
                self._routes[frame[_SYSTEM]] = _Route(source, now_s)
                self._bystanders.pop(source, None)
                self._remember_everybody()
                return
        self.knocked(source)

    def knocked(self, source: Source) -> None:
        """Let a source have what is for all; also of a refused frame, for a signing clock behind catches up by it."""
        if source not in self._everybody and len(self._bystanders) < MOST_BYSTANDERS:
            self._bystanders[source] = None
            self._remember_everybody()

    def of(self, system_id: int) -> Collection[Source]:
        """Return where a system is answered: everywhere when it is 0, for all, or its autopilot is not known yet."""
        route = self._routes.get(system_id)
        return self._everybody if route is None else (route.source,)

    def contested(self, now_s: float) -> frozenset[int]:
        """Return the system ids heard from two addresses at a time lately."""
        return frozenset(
            system_id for system_id, route in self._routes.items() if now_s - route.contested_s < CONTESTED_S
        )

    def _remember_everybody(self) -> None:
        routed = (route.source for route in self._routes.values())
        self._everybody = dict.fromkeys((*routed, *self._bystanders))


def _is_autopilots_heartbeat(frame: bytearray) -> bool:
    if frame[_MESSAGE] != _HEARTBEAT or frame[_LENGTH] <= _AUTOPILOT_AT:
        return False
    autopilot: int = frame[10 + _AUTOPILOT_AT]
    return bool(autopilot != mavlink.MAV_AUTOPILOT_INVALID)
