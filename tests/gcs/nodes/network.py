"""A bus in virtual time between parties that can be cut off from each other, with delays."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from typing import Any

from drivers.clock import Clock
from tests.fakes import FakeBus, matches

Handler = Callable[[str, bytes], None]
Alive = Callable[[str, bool], None]


class Network:
    """What all parties share. `cut` are the parties that nothing reaches, and that reach nobody."""

    def __init__(self, clock: Clock, delay_s: float = 0.0, jitter_s: float = 0.0, seed: int = 1) -> None:
        self.clock, self.delay_s, self.jitter_s = clock, delay_s, jitter_s
        self.cut: set[str] = set()
        self.parties: dict[str, Party] = {}
        self.alive: dict[str, str] = {}
        """The party that has declared each key."""
        self._watchers: list[tuple[str, str, Alive]] = []
        self._random = random.Random(seed)
        self._tasks: set[asyncio.Task[None]] = set()

    def party(self, name: str) -> Party:
        self.parties[name] = Party(self, name)
        return self.parties[name]

    def end(self, name: str) -> None:
        """A party's process ends: nothing comes from it or reaches it, and everybody is told at once."""
        self.cut.add(name)
        self.told_gone(name)

    def told_gone(self, name: str) -> None:
        for key in [key for key, of in self.alive.items() if of == name]:
            for watcher, expression, handler in self._watchers:
                if watcher != name and matches(expression, key):
                    handler(key, False)  # noqa: FBT003 - as the bus calls it

    def heal(self, name: str) -> None:
        self.cut.discard(name)
        for key in [key for key, of in self.alive.items() if of == name]:
            self.declared(key)

    def declared(self, key: str) -> None:
        for _, expression, handler in self._watchers:
            if matches(expression, key):
                handler(key, True)  # noqa: FBT003 - as the bus calls it

    def watch(self, party: str, expression: str, handler: Alive) -> None:
        self._watchers.append((party, expression, handler))
        for key in self.alive:
            if matches(expression, key):
                handler(key, True)  # noqa: FBT003 - as the bus calls it

    def deliver(self, sender: str, key: str, payload: bytes) -> None:
        for name, party in self.parties.items():
            handlers = [handler for expression, handler in party.handlers if matches(expression, key)]
            if handlers and (name == sender or not {name, sender} & self.cut):
                self._hand_over(handlers, key, payload, 0.0 if name == sender else self._delay_s())

    def _delay_s(self) -> float:
        return self.delay_s + self.jitter_s * self._random.random()

    def _hand_over(self, handlers: list[Handler], key: str, payload: bytes, delay_s: float) -> None:
        if delay_s <= 0.0:
            for handler in handlers:
                handler(key, payload)
            return

        async def later() -> None:
            await self.clock.sleep(delay_s)
            for handler in handlers:
                handler(key, payload)

        task = asyncio.ensure_future(later())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


class Party(FakeBus):
    """One party's way to the others."""

    def __init__(self, network: Network, name: str) -> None:
        super().__init__()
        self.network, self.name = network, name
        self.handlers: list[tuple[str, Handler]] = []

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        self.handlers.append((key_expression, handler))

    def declare_alive(self, key: str) -> None:
        self.network.alive[key] = self.name
        self.network.declared(key)

    def watch_alive(self, key_expression: str, handler: Alive) -> None:
        self.network.watch(self.name, key_expression, handler)

    def _deliver(self, key: Any, payload: bytes) -> None:
        self.sent.append((key, payload))
        self.network.deliver(self.name, key, payload)
