"""Stand-ins at the seams: a clock moved by hand and a bus in memory."""

import asyncio
import heapq
from functools import lru_cache
from itertools import count

from drivers.errors import BusError

FAKE_UNIX_NS = 1_800_000_000_000_000_000
"""What a ManualClock shows as the time since 1970 when it starts, ns."""

_SETTLING_ROUNDS = 20
_QUIET_ROUNDS = 2
"""In the second round comes what a socket or a pipe brought in the first."""


async def settle():
    """Let every task that can run now do so, until all wait again."""
    ready = asyncio.get_running_loop()._ready  # no public way tells that nobody else can run
    quiet = 0
    for _ in range(_SETTLING_ROUNDS):
        await asyncio.sleep(0)
        quiet = 0 if ready else quiet + 1
        if quiet == _QUIET_ROUNDS:
            break


class ManualClock:
    """A clock that stands still until a test advances it; whoever sleeps on it wakes in order, at the exact time."""

    def __init__(self, now_s=100.0, unix_ns=FAKE_UNIX_NS):
        self._now_s = now_s
        self._started_s = now_s
        self._started_ns = unix_ns
        self._sleepers = []
        self._order = count()

    def now_s(self):
        return self._now_s

    def unix_ns(self):
        return self._started_ns + round((self._now_s - self._started_s) * 1e9)

    async def sleep(self, duration_s):
        if duration_s <= 0.0:
            await asyncio.sleep(0)
            return
        woken = asyncio.get_running_loop().create_future()
        heapq.heappush(self._sleepers, (self._now_s + duration_s, next(self._order), woken))
        await woken

    @property
    def sleeping(self):
        """How many tasks sleep on this clock."""
        return sum(not woken.done() for _, _, woken in self._sleepers)

    def jump(self, duration_s):
        """Move the time on without waking anybody, as when the event loop is busy: they wake at the next advance."""
        self._now_s += duration_s

    async def advance(self, duration_s):
        """Let time pass: every sleeper due wakes at its own time, and settles before the next one wakes."""
        await settle()
        end_s = self._now_s + duration_s
        while self._sleepers and self._sleepers[0][0] <= end_s:
            due_s, _, woken = heapq.heappop(self._sleepers)
            if woken.done():
                continue
            self._now_s = max(self._now_s, due_s)
            woken.set_result(None)
            await settle()
        self._now_s = end_s
        await settle()


class FakeBus:
    """A bus in memory, shared by everybody who is handed it.

    Samples are delivered at once, within the put. While `up` is False whatever is put is lost, as on a real bus whose
    router has gone. `sent` keeps every put as (key, payload); `urgent_keys` and `reliable_keys` say how.
    """

    def __init__(self):
        self.up = True
        self.sent = []
        self.urgent_keys = set()
        self.reliable_keys = set()
        self._handlers = []
        self._remembered = {}
        self._histories = {}
        self._answers = {}

    def put_latest(self, key, payload, *, urgent=False):
        if urgent:
            self.urgent_keys.add(key)
        self._deliver(key, payload)

    def put_reliably(self, key, payload):
        self.reliable_keys.add(key)
        self._remembered[key] = payload
        self._deliver(key, payload)

    def put_history(self, key, payload):
        self.reliable_keys.add(key)
        self._histories.setdefault(key, []).append(payload)
        self._deliver(key, payload)

    async def fetch_history(self, key):
        await asyncio.sleep(0)
        return list(self._histories.get(key, ())) if self.up else []

    def serve(self, key, answer):
        self._answers[key] = answer

    async def ask(self, key, payload):
        await asyncio.sleep(0)
        if not self.up or key not in self._answers:
            raise BusError(f"{key} is not answered")
        return self._answers[key](payload)

    def subscribe(self, key_expression, handler):
        self._handlers.append((key_expression, handler))

    async def fetch(self, key_expression):
        await asyncio.sleep(0)
        if not self.up:
            return {}
        return {key: payload for key, payload in self._remembered.items() if matches(key_expression, key)}

    def connected(self):
        return self.up

    def payloads(self, key):
        """Return what was put on a key, in order."""
        return [payload for at, payload in self.sent if at == key]

    def _deliver(self, key, payload):
        self.sent.append((key, payload))
        if not self.up:
            return
        for key_expression, handler in list(self._handlers):
            if matches(key_expression, key):
                handler(key, payload)


@lru_cache(maxsize=10_000)
def matches(key_expression, key):
    """Return whether a key expression, whose chunks may be `*`, covers a key."""
    wanted, chunks = key_expression.split("/"), key.split("/")
    return len(wanted) == len(chunks) and all(want in ("*", chunk) for want, chunk in zip(wanted, chunks, strict=True))
