"""Samples on their way from zenoh's threads to the event loop: bounded, fair between keys, and counted when dropped.

Whoever floods one key loses what it sent itself. The event loop takes a portion at a time, so that timers, links and
everything else have their turn in between.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

log = logging.getLogger(__name__)

Handler = Callable[[str, bytes], None]
"""Gets the key and the payload of one sample, on the event loop."""

MOST_WAITING: Final = 4096
"""So many samples wait for the event loop at the most..."""
MOST_WAITING_BYTES: Final = 32 * 2**20
"""...and so many bytes of them."""
_PORTION: Final = 64

_Whose = tuple[Handler, str]
"""Whose samples wait their turn: those of one key, for one handler."""


@dataclass
class Losses:
    """What was dropped on the way to the event loop."""

    overtaken: int = 0
    """Samples dropped because too much waited: the oldest of a key with no less than its share."""
    unanswered: int = 0
    """Queries dropped because too many waited."""


class Inbox:
    """What waits for one event loop. `hand_over` may be called from any thread.

    Samples of one key are delivered in the order they came; keys take turns.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.losses = Losses()
        self.waiting = 0
        self._waiting_bytes = 0
        self._loop = loop
        self._queues: OrderedDict[_Whose, deque[bytes]] = OrderedDict()
        self._crowder: _Whose = (_nobody, "")
        self._scheduled = False
        self._lock = threading.Lock()

    def call(self, callback: Callable[..., None], *arguments: Any) -> None:
        """Let the event loop call anything once."""
        with contextlib.suppress(RuntimeError):  # the loop may have closed
            self._loop.call_soon_threadsafe(callback, *arguments)

    def hand_over(self, handler: Handler, key: str, payload: bytes) -> None:
        """Let the event loop call a handler with a sample, unless newer ones take its place before it comes to that."""
        with self._lock:
            self._make_room(handler, key, len(payload))
            self._queues.setdefault((handler, key), deque()).append(payload)
            self.waiting += 1
            self._waiting_bytes += len(payload)
            if self._scheduled or self._loop.is_closed():
                return
            self._scheduled = True
        self.call(self._deliver)

    def _make_room(self, handler: Handler, key: str, size_bytes: int) -> None:
        while self.waiting >= MOST_WAITING or (self.waiting and self._waiting_bytes + size_bytes > MOST_WAITING_BYTES):
            self._crowder = self._crowding((handler, key))
            self._take(self._crowder)
            if not self.losses.overtaken:
                log.warning("more comes over the bus than can be taken in, much of it on %s: some is dropped", key)
            self.losses.overtaken += 1

    def _crowding(self, newcomer: _Whose) -> _Whose:
        """Return a key with no less than its share of what waits: that of the newcomer, the last one, or any other."""
        keys = itertools.chain((newcomer, self._crowder), self._queues)
        return next(key for key in keys if len(self._queues.get(key, ())) * len(self._queues) >= self.waiting)

    def _take(self, whose: _Whose) -> bytes:
        """Take the oldest sample of a key, which goes to the end of the line if it has another."""
        queue = self._queues.pop(whose)
        payload = queue.popleft()
        if queue:
            self._queues[whose] = queue
        self.waiting -= 1
        self._waiting_bytes -= len(payload)
        return payload

    def _deliver(self) -> None:
        """Call the handlers of a portion of what waits; one that fails takes no other with it."""
        for _ in range(_PORTION):
            with self._lock:
                if not self._queues:
                    self._scheduled = False
                    return
                whose = next(iter(self._queues))
                payload = self._take(whose)
            handler, key = whose
            try:
                handler(key, payload)
            except Exception as error:  # noqa: BLE001 - it is told like that of any callback
                self._loop.call_exception_handler(
                    {"message": f"what came on {key} could not be taken", "exception": error}
                )
        self._loop.call_soon(self._deliver)


def _nobody(key: str, payload: bytes) -> None:
    """Take nothing."""
