"""The zenoh session: opened in a block, always closed, explicit endpoints, nothing multicast.

A zenoh callback only hands over to the event loop; handlers run there, samples of one key in the order they came.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol

import zenoh

from drivers.bus.inbox import Handler, Inbox, Losses
from drivers.bus.openness import openness
from drivers.errors import BusError

__all__ = ["Answer", "Bus", "BusEndpoint", "Handler", "LiveBus", "Losses", "open_bus", "require_closed"]

Answer = Callable[[bytes], bytes]
"""Gets the payload of one query and returns that of its reply, on the event loop."""

_CLOSE_WAIT_US = 200_000
_LEASE_MS = 2_000
"""After this long without a sign of life the other side counts as gone."""

LARGEST_BYTES: Final = 4 * 2**20
"""Whatever is larger is lost on its way: nothing that is said on the bus is nearly so large."""
MOST_QUERIES: Final = 256
"""So many queries wait for their answers at the most; others are dropped."""
HISTORY_KEPT: Final = 4096
"""How many values of a history can be fetched: the latest."""
ANSWERED_WITHIN_S: Final = 2.0
"""What has waited longer for the event loop is answered with an error, and nothing is done about it any more."""
ASK_TIMEOUT_S: Final = ANSWERED_WITHIN_S + 1.0
"""How long one who asks waits: longer, so that nothing is done after it has given up."""
_FETCH_TIMEOUT_S: Final = 2.0


class Bus(Protocol):
    """What the service and the sensors ask of the bus."""

    def put_latest(self, key: str, payload: bytes, *, urgent: bool = False) -> None:
        """Publish a value of which only the latest matters; dropped when congested. Urgent ones are not batched."""
        ...

    def put_reliably(self, key: str, payload: bytes) -> None:
        """Publish a value that must arrive; a later subscriber may `fetch` the last one while this bus is open."""
        ...

    def put_history(self, key: str, payload: bytes) -> None:
        """Publish a value that must arrive; a later subscriber may `fetch_history`, HISTORY_KEPT values of it."""
        ...

    def serve(self, key: str, answer: Answer) -> None:
        """Answer every query of a key on the event loop, until the bus closes; nobody but the asker hears it."""
        ...

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        """Call `handler` on the event loop for every sample that matches, until the bus closes.

        Where more comes than can be taken in, a key that has more than its share loses its oldest samples.
        """
        ...

    async def fetch(self, key_expression: str) -> dict[str, bytes]:
        """Return the last reliably put value of every matching key, as its publisher remembers it."""
        ...

    async def fetch_history(self, key: str) -> list[bytes]:
        """Return what its publisher put into a history so far, in order."""
        ...

    async def ask(self, key: str, payload: bytes) -> bytes:
        """Return the answer to a query. BusError when nobody answers within ASK_TIMEOUT_S, or with an error."""
        ...

    def connected(self) -> bool:
        """Return whether the router can be reached."""
        ...


Liveliness = Callable[[str, bool], None]
"""Gets a key, and whether whoever declared it lives, on the event loop."""


class LiveBus(Bus, Protocol):
    """A bus that tells who is there, and what it could not deliver."""

    @property
    def losses(self) -> Losses:
        """What came, and was dropped on the way to the event loop."""
        ...

    def declare_alive(self, key: str) -> None:
        """Let everybody know that this process lives, until the bus closes or the process ends, however it does."""
        ...

    def watch_alive(self, key_expression: str, handler: Liveliness) -> None:
        """Call `handler` for everybody alive now, and whenever one comes or goes, until the bus closes."""
        ...


@dataclass(frozen=True)
class BusEndpoint:
    """How a process takes part in the bus: as a client of the router at `endpoint`, or as that router."""

    endpoint: str
    role: Literal["client", "router"] = "client"
    insecure: bool = field(default=False, kw_only=True)
    """Whether it is meant that strangers can join: without keys, off loopback."""

    @property
    def closed(self) -> bool:
        """Whether nobody joins without keys."""
        return False

    def configuration(self) -> zenoh.Config:
        """Return the zenoh configuration; every setting that would open more than the endpoint is off."""
        config = zenoh.Config()
        settings: dict[str, object] = {
            "mode": self.role,
            "connect/endpoints": [self.endpoint] if self.role == "client" else [],
            "listen/endpoints": [self.endpoint] if self.role == "router" else [],
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "transport/shared_memory/enabled": False,
            "transport/link/rx/max_message_size": LARGEST_BYTES,
            "transport/link/tx/lease": _LEASE_MS,
            "transport/link/tx/queue/congestion_control/block/wait_before_close": _CLOSE_WAIT_US,
        }
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        return config


def require_closed(endpoint: BusEndpoint) -> None:
    """Return when no stranger can join at an endpoint, or it is meant that they can. BusError otherwise."""
    if endpoint.closed or endpoint.insecure:
        return
    if (problem := openness(endpoint.endpoint)) is not None:
        raise BusError(f"{problem}, or give --insecure when nobody else is on that network")


@contextlib.asynccontextmanager
async def open_bus(endpoint: BusEndpoint) -> AsyncIterator[LiveBus]:
    """Open the bus and close it with the block.

    BusError when there is no router, when the port is taken, or when strangers can join and nobody said `insecure`.
    """
    require_closed(endpoint)
    try:
        session = await asyncio.to_thread(zenoh.open, endpoint.configuration())
    except zenoh.ZError as error:
        raise BusError(
            f"the bus at {endpoint.endpoint} cannot be opened as {endpoint.role}: {error}. "
            "Is its router running, and the endpoint written as tcp/HOST:PORT?"
        ) from error
    try:
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="bus-replies") as replies:
            yield _ZenohBus(session, asyncio.get_running_loop(), replies)
    finally:
        with contextlib.suppress(zenoh.ZError):  # a router that has frozen does not say goodbye
            await asyncio.to_thread(session.close)


class _ZenohBus:
    def __init__(self, session: zenoh.Session, loop: asyncio.AbstractEventLoop, replies: ThreadPoolExecutor) -> None:
        self._session = session
        self._replies = replies
        self._inbox = Inbox(loop)
        self._queries = threading.Semaphore(MOST_QUERIES)
        self._remembered: dict[str, bytes] = {}
        self._histories: dict[str, deque[bytes]] = {}
        self._queryables: set[str] = set()
        self._alive: list[zenoh.LivelinessToken] = []

    @property
    def losses(self) -> Losses:
        return self._inbox.losses

    def put_latest(self, key: str, payload: bytes, *, urgent: bool = False) -> None:
        self._session.put(
            key,
            payload,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH if urgent else zenoh.Priority.DATA,
            express=urgent,
        )

    def put_reliably(self, key: str, payload: bytes) -> None:
        self._remembered[key] = payload
        if key not in self._queryables:
            self._queryables.add(key)
            self._session.declare_queryable(key, lambda query: query.reply(key, self._remembered[key]))
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def put_history(self, key: str, payload: bytes) -> None:
        if key not in self._histories:
            history: deque[bytes] = deque(maxlen=HISTORY_KEPT)

            def replay(query: zenoh.Query) -> None:
                for put in tuple(history):
                    query.reply(key, put)

            self._histories[key] = history
            self._session.declare_queryable(key, replay)
        self._histories[key].append(payload)
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def serve(self, key: str, answer: Answer) -> None:
        def take(query: zenoh.Query) -> None:
            if not self._queries.acquire(blocking=False):
                self._inbox.losses.unanswered += 1
                with query:  # it ends without an answer
                    return
            self._inbox.call(self._answer, query, key, answer, time.monotonic() + ANSWERED_WITHIN_S)

        self._session.declare_queryable(key, take)

    def _answer(self, query: zenoh.Query, key: str, answer: Answer, until_s: float) -> None:
        """Answer a query on the event loop; with an error when that comes too late, or the answer fails."""
        refusal = "nothing was done: it came too late, after the asker had given up"
        payload = None
        try:
            if time.monotonic() < until_s:
                refusal = "answering it failed: see what the service says"
                payload = answer(b"" if query.payload is None else query.payload.to_bytes())
        finally:
            with contextlib.suppress(RuntimeError):  # the bus may have closed
                # an asker that is stuck holds nobody up
                self._replies.submit(self._reply, query, key, payload, refusal)

    def _reply(self, query: zenoh.Query, key: str, payload: bytes | None, refusal: str) -> None:
        self._queries.release()
        with contextlib.suppress(zenoh.ZError), query:  # the asker may have gone
            if payload is None:
                query.reply_err(refusal)
            else:
                query.reply(key, payload)

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        self._session.declare_subscriber(
            key_expression,
            lambda sample: self._inbox.hand_over(handler, str(sample.key_expr), sample.payload.to_bytes()),
        )

    def declare_alive(self, key: str) -> None:
        self._alive.append(self._session.liveliness().declare_token(key))

    def watch_alive(self, key_expression: str, handler: Liveliness) -> None:
        def take(sample: zenoh.Sample) -> None:
            self._inbox.call(handler, str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._session.liveliness().declare_subscriber(key_expression, take, history=True)

    async def fetch(self, key_expression: str) -> dict[str, bytes]:
        def ask() -> dict[str, bytes]:
            replies = self._session.get(key_expression, timeout=_FETCH_TIMEOUT_S)
            return {str(reply.ok.key_expr): reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None}

        return await asyncio.to_thread(ask)

    async def fetch_history(self, key: str) -> list[bytes]:
        def ask() -> list[bytes]:
            replies = self._session.get(key, timeout=_FETCH_TIMEOUT_S, consolidation=zenoh.ConsolidationMode.NONE)
            return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]

        return await asyncio.to_thread(ask)

    async def ask(self, key: str, payload: bytes) -> bytes:
        def ask() -> bytes:
            replies = list(self._session.get(key, payload=payload, timeout=ASK_TIMEOUT_S))
            for reply in replies:
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
            errors = [reply.err.payload.to_bytes().decode(errors="replace") for reply in replies if reply.err]
            raise BusError(f"{key} is not answered: {'; '.join(errors) or 'nobody serves it'}")

        return await asyncio.to_thread(ask)

    def connected(self) -> bool:
        return bool(list(self._session.info.routers_zid()))
