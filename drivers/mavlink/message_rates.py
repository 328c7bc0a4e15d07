"""The messages asked of an autopilot, until they come: it forgets them all when it reboots.

An acknowledgement is not awaited: only the message itself proves anything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from drivers.clock import Clock

PATIENCE_S: Final = 3.0
_MISSED_MESSAGES: Final = 3


@dataclass
class _Wanted:
    rate_hz: float
    asked_s: float
    came_s: float | None = None
    doubted: bool = False


class MessageRates:
    """The rates wanted of one vehicle, and which of its messages come. `request` asks for one message id at a rate."""

    def __init__(self, clock: Clock, request: Callable[[int, float], None]) -> None:
        self._clock = clock
        self._request = request
        self._wanted: dict[int, _Wanted] = {}

    @property
    def missing(self) -> tuple[int, ...]:
        """The ids of the messages that have not come since they were wanted, or have stopped."""
        now_s = self._clock.now_s()
        return tuple(
            message_id
            for message_id, wanted in self._wanted.items()
            if wanted.came_s is None or now_s - wanted.came_s > _patience_s(wanted.rate_hz)
        )

    def ask(self, rates_hz: Mapping[int, float]) -> None:
        """Want messages by their id at a rate each, from now on."""
        for message_id, rate_hz in rates_hz.items():
            self._wanted[message_id] = _Wanted(rate_hz, self._clock.now_s())
            self._request(message_id, rate_hz)

    def ask_again(self) -> None:
        """Ask anew for everything, as after a reboot."""
        self.ask({message_id: wanted.rate_hz for message_id, wanted in self._wanted.items()})

    def came(self, message_id: int) -> None:
        """Take note of a message."""
        if message_id in self._wanted:
            wanted = self._wanted[message_id]
            wanted.came_s, wanted.doubted = self._clock.now_s(), False

    def review(self) -> bool:
        """Ask anew for what does not come; return whether one that did come has just been found to have stopped.

        To be called about once a second. What is missing is asked for when it still is the second time: after a pause
        of this service everything comes late at once.
        """
        now_s, stopped = self._clock.now_s(), False
        for message_id in self.missing:
            wanted = self._wanted[message_id]
            if now_s - wanted.asked_s > _patience_s(wanted.rate_hz):
                if wanted.doubted:
                    stopped = stopped or wanted.came_s is not None
                    self.ask({message_id: wanted.rate_hz})
                else:
                    wanted.doubted = True
        return stopped


def _patience_s(rate_hz: float) -> float:
    return max(PATIENCE_S, _MISSED_MESSAGES / rate_hz)
