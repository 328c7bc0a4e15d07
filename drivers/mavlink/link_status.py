"""How a link fares: what passed, what was lost, and whether anybody is there."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import Final

WINDOW_S: Final = 10.0
"""The loss ratio counts what was heard, and missed, in this time."""
SILENT_AFTER_S: Final = 3.0
"""An autopilot's heartbeat comes each second."""


class LinkState(Enum):
    """What a link does now."""

    CONNECTING = "connecting"
    """Nothing has been heard yet."""
    UP = "up"
    SILENT = "silent"
    """It is there, but nothing has been heard for a while."""
    DOWN = "down"
    """The connection or the device is gone; it is tried again."""


@dataclass
class LinkCounters:
    """What passed over a link."""

    received: int = 0
    sent: int = 0
    lost: int = 0
    """Received frames missing, by the gaps in each sender's numbering."""
    refused: int = 0
    """Frames whose signature was not accepted."""
    dropped: int = 0
    """Frames that could not be sent, and motions too late to be of use."""


@dataclass(frozen=True)
class LinkStatus:
    """A link at one moment, for screens and reports."""

    address: str
    state: LinkState
    received: int
    sent: int
    lost: int
    refused: int
    """Frames of senders that could not prove, or do not have, the right to speak for their system."""
    dropped: int
    skipped_bytes: int
    loss_ratio: float | None
    """Of the last WINDOW_S, 0 to 1; None when nothing was heard."""
    silent_for_s: float
    """Since anything was heard; infinite before."""
    heard_system_ids: tuple[int, ...]
    contested_system_ids: tuple[int, ...]


class Reception:
    """Counts received frames and the gaps between them, in all and over the last WINDOW_S."""

    def __init__(self, counters: LinkCounters) -> None:
        self.last_s = -math.inf
        self._counters = counters
        self._next_sequence: dict[int, int] = {}
        self._past: deque[tuple[float, int, int]] = deque(maxlen=math.ceil(WINDOW_S) + 1)

    def count(self, source: int, sequence: int, now_s: float) -> None:
        """Take in the number of one frame of one sender."""
        counters = self._counters
        if not self._past or now_s - self._past[-1][0] >= 1.0:
            self._past.append((now_s, counters.received, counters.lost))
        self.last_s = now_s
        counters.received += 1
        gap = (sequence - self._next_sequence.get(source, sequence)) & 0xFF
        if gap < 128:  # a larger gap is an older frame arriving late
            counters.lost += gap
            self._next_sequence[source] = (sequence + 1) & 0xFF

    def loss_ratio(self, now_s: float) -> float | None:
        """Return the share of the last WINDOW_S that was lost, or None when nothing was heard."""
        for time_s, received_before, lost_before in self._past:
            if now_s - time_s <= WINDOW_S:
                received, lost = self._counters.received - received_before, self._counters.lost - lost_before
                return lost / (received + lost)
        return None
