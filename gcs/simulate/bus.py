"""A bus within one process: samples are delivered in the put."""

from __future__ import annotations

import re
from collections import deque

from drivers.bus.session import HISTORY_KEPT, Answer, Handler
from drivers.errors import BusError


class LocalBus:
    """A `Bus` for one event loop, without a router; it is always up."""

    def __init__(self) -> None:
        self._handlers: list[tuple[re.Pattern[str], Handler]] = []
        self._remembered: dict[str, bytes] = {}
        self._histories: dict[str, deque[bytes]] = {}
        self._answers: dict[str, Answer] = {}

    def put_latest(self, key: str, payload: bytes, *, urgent: bool = False) -> None:
        """Deliver a value."""
        del urgent  # nothing waits here
        for pattern, handler in list(self._handlers):
            if pattern.fullmatch(key):
                handler(key, payload)

    def put_reliably(self, key: str, payload: bytes) -> None:
        """Deliver a value, and remember it for `fetch`."""
        self._remembered[key] = payload
        self.put_latest(key, payload)

    def put_history(self, key: str, payload: bytes) -> None:
        """Deliver a value, and remember it for `fetch_history`."""
        self._histories.setdefault(key, deque(maxlen=HISTORY_KEPT)).append(payload)
        self.put_latest(key, payload)

    def serve(self, key: str, answer: Answer) -> None:
        """Answer every query of a key."""
        self._answers[key] = answer

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        """Call the handler for every sample whose key matches; a `*` stands for one chunk."""
        self._handlers.append((_pattern(key_expression), handler))

    async def fetch(self, key_expression: str) -> dict[str, bytes]:
        """Return the last reliably put value of every matching key."""
        pattern = _pattern(key_expression)
        return {key: payload for key, payload in self._remembered.items() if pattern.fullmatch(key)}

    async def fetch_history(self, key: str) -> list[bytes]:
        """Return what was put into a history so far, in order."""
        return list(self._histories.get(key, ()))

    async def ask(self, key: str, payload: bytes) -> bytes:
        """Return the answer to a query; BusError when nobody serves it."""
        if key not in self._answers:
            raise BusError(f"nobody answers {key}")
        return self._answers[key](payload)

    def connected(self) -> bool:
        """Return that it is up."""
        return True


def _pattern(key_expression: str) -> re.Pattern[str]:
    return re.compile("/".join("[^/]+" if chunk == "*" else re.escape(chunk) for chunk in key_expression.split("/")))
