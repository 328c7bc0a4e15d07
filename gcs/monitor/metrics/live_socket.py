"""A run over a WebSocket: the latest state, and every event. Who does not keep up gets the latest, or is closed."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from dataclasses import dataclass, field
from typing import Final

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from drivers.bus.run_messages import RunEvent, RunSetup, RunState
from drivers.tasks import background
from gcs.monitor.client import RunClient

MOST: Final = 200
"""So many may be connected at once."""
STUCK_S: Final = 10.0
"""One that takes nothing for this long is closed."""
_EVENTS_WAITING: Final = 500
_TRY_AGAIN_LATER: Final = 1013


class LiveMessage(msgspec.Struct, frozen=True, omit_defaults=True):
    """One message of the live socket: exactly one of the three."""

    setup: RunSetup | None = None
    state: RunState | None = None
    event: RunEvent | None = None


@dataclass
class _Outbox:
    """What waits for one reader; bounded."""

    setup: RunSetup | None = None
    state: RunState | None = None
    events: deque[RunEvent] = field(default_factory=lambda: deque(maxlen=_EVENTS_WAITING))
    filled: asyncio.Event = field(default_factory=asyncio.Event)

    def take_all(self) -> list[LiveMessage]:
        """Return what waits, in the order it makes sense."""
        self.filled.clear()
        messages = [] if self.setup is None else [LiveMessage(setup=self.setup)]
        messages += [LiveMessage(event=event) for event in self.events]
        messages += [] if self.state is None else [LiveMessage(state=self.state)]
        self.setup = self.state = None
        self.events.clear()
        return messages


@dataclass
class LiveSockets:
    """All that are connected. Every state is encoded once, however many there are."""

    client: RunClient
    _outboxes: list[_Outbox] = field(default_factory=list)
    _encoded: tuple[RunState | None, str] = (None, "")

    def __post_init__(self) -> None:
        self.client.on_setup.append(self._take_setup)
        self.client.on_state.append(self._take_state)
        self.client.on_event.append(self._take_event)

    async def serve(self, socket: WebSocket) -> None:
        """Send one reader the run until he leaves."""
        await socket.accept()
        if len(self._outboxes) >= MOST:
            await socket.close(_TRY_AGAIN_LATER, "too many are connected")
            return
        outbox = _Outbox(self.client.setup, self.client.state, deque(self.client.events, maxlen=_EVENTS_WAITING))
        outbox.filled.set()
        self._outboxes.append(outbox)
        try:
            async with background(self._send_all(socket, outbox)):
                while True:
                    await socket.receive_text()  # whatever is said here is passed over
        except* (WebSocketDisconnect, TimeoutError, RuntimeError, KeyError):
            pass  # he left, does not read, or said something else than text
        finally:
            self._outboxes.remove(outbox)
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # he may have gone
                await socket.close()

    async def _send_all(self, socket: WebSocket, outbox: _Outbox) -> None:
        while True:
            await outbox.filled.wait()
            for message in outbox.take_all():
                async with asyncio.timeout(STUCK_S):
                    await socket.send_text(self._text(message))

    def _text(self, message: LiveMessage) -> str:
        if message.state is None:
            return msgspec.json.encode(message).decode()
        if self._encoded[0] is not message.state:
            self._encoded = (message.state, msgspec.json.encode(message).decode())
        return self._encoded[1]

    def _take_setup(self, setup: RunSetup) -> None:
        for outbox in self._outboxes:
            outbox.setup = setup
            outbox.filled.set()

    def _take_state(self, state: RunState) -> None:
        for outbox in self._outboxes:
            outbox.state = state
            outbox.filled.set()

    def _take_event(self, event: RunEvent) -> None:
        for outbox in self._outboxes:
            outbox.events.append(event)
            outbox.filled.set()
