"""Which of several ways to one vehicle tells its state late, and which messages were told already.

Timed messages carry the autopilot's own clock, the time since it was switched on. On a prompt way that clock started
at one fixed moment of ours; on a way that is late by some seconds it seems to have started those seconds later. What
carries no time is as late as the timed messages of its way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

from drivers.mavlink.codec import Message

LATE_S: Final = 0.5
"""State told later than this after another way told it is not handed on."""
PROOF_S: Final = 1.0
"""For how long a timed message proves that its way is prompt."""
_RESTART_S: Final = 1.0
"""An autopilot's clock set back by more, as one way tells it, is an autopilot that was restarted."""
_FORGOTTEN_S: Final = 10.0


class Verdict(Enum):
    """What a message is worth."""

    FRESH = "fresh"
    REPEATED = "repeated"
    """Its way is prompt, but another was quicker."""
    LATE = "late"


@dataclass
class _Way:
    time_s: float = -math.inf
    """By the autopilot's clock."""
    heard_s: float = -math.inf
    """When that was heard."""
    restarts: int = 0

    @property
    def started_s(self) -> float:
        """When the autopilot seems to have been switched on."""
        return self.heard_s - self.time_s


class Freshness:
    """Compares the ways to one vehicle, by their numbers from 0 on."""

    def __init__(self, ways: int) -> None:
        self._ways = [_Way() for _ in range(ways)]
        self._restarts = 0
        self._newest_s: dict[int, float] = {}

    def verdict(self, number: int, message: Message, now_s: float) -> Verdict:
        """Return what a message that came on a way now is worth."""
        way, time_boot_ms = self._ways[number], getattr(message, "time_boot_ms", None)
        if not time_boot_ms:
            return Verdict.FRESH if self._is_trusted(way, now_s) else Verdict.LATE
        self._note(way, time_boot_ms * 1e-3, now_s)
        if self._is_late(way, now_s):
            return Verdict.LATE
        message_id = message.get_msgId()
        if way.time_s <= self._newest_s.get(message_id, -math.inf):
            return Verdict.REPEATED
        self._newest_s[message_id] = way.time_s
        return Verdict.FRESH

    def _note(self, way: _Way, time_s: float, now_s: float) -> None:
        """Take in what a way tells of the autopilot's clock, and whether it was restarted since."""
        set_back = time_s < way.time_s - _RESTART_S
        if set_back and way.restarts == self._restarts:
            self._restarts += 1
            self._newest_s.clear()
        joins = set_back or now_s - way.heard_s > _FORGOTTEN_S
        way.time_s, way.heard_s = time_s, now_s
        if joins or any(
            other.restarts == self._restarts and way.started_s > other.started_s - _RESTART_S for other in self._ways
        ):
            way.restarts = self._restarts

    def _is_trusted(self, way: _Way, now_s: float) -> bool:
        """Return whether what carries no time may be believed: its way is prompt, or no other proves to be."""
        if now_s - way.heard_s <= PROOF_S:
            return not self._is_late(way, now_s)
        return all(now_s - other.heard_s > PROOF_S or self._is_late(other, now_s) for other in self._ways)

    def _is_late(self, way: _Way, now_s: float) -> bool:
        """Return whether another way, heard lately, tells more than LATE_S sooner or of a restart since."""
        if way.restarts < self._restarts:
            return True
        return any(
            way.started_s - other.started_s > LATE_S
            for other in self._ways
            if other.restarts == self._restarts and now_s - other.heard_s <= PROOF_S
        )
