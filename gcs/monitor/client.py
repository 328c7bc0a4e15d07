"""Follows a run over the bus from another process, for any screen: the latest state, the setup, the events.

It only reads, but for the operator's words, and holds nobody up: what it does not keep up with is dropped for it. It
finds the run again when the service, the router or this end was gone, and the next run when one begins.
"""

from __future__ import annotations

import contextlib
import logging
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import ControlReply, ControlRequest, MalformedMessageError, decode, encode
from drivers.bus.run_messages import (
    ENDED_PHASES,
    EVENTS_KEPT,
    Alert,
    Events,
    EventsRequest,
    RunEvent,
    RunSetup,
    RunState,
    decode_run,
)
from drivers.bus.security import with_keys
from drivers.bus.session import Bus, BusEndpoint, open_bus
from drivers.clock import Clock, SystemClock
from drivers.errors import BusError
from drivers.tasks import background
from gcs.errors import ServiceError
from gcs.monitor.history import RunHistory
from gcs.monitor.proven import Words, plainly
from gcs.recording.bus_address import BusAddress

log = logging.getLogger(__name__)

LOOK_S: Final = 0.5
"""How often what is missing is asked for, and whether the run is still where it was."""
LOST_S: Final = 2.0
"""A state older than this is shown as old."""

OpenBus = Callable[[BusEndpoint], AbstractAsyncContextManager[Bus]]


def joining(keys: Path | None) -> OpenBus:
    """Return what opens a bus with one's file of `keys init`, or without one. BusError when the file is no good."""
    if keys is None:
        return open_bus
    with_keys(BusEndpoint("tls/localhost:7447"), keys)  # what is wrong with the file is said now

    def join(endpoint: BusEndpoint) -> AbstractAsyncContextManager[Bus]:
        try:
            return open_bus(with_keys(endpoint, keys))
        except BusError as error:
            raise ServiceError(f"{error}. An open bus is joined without --keys.") from error

    return join


@dataclass
class RunClient:
    """What is known of a run. `find` says where it is, or raises ServiceError; everything happens on the event loop."""

    find: Callable[[], BusAddress]
    clock: Clock = field(default_factory=SystemClock)
    open_bus: OpenBus = open_bus
    say: Words = plainly
    """Puts a word to a swarm as it goes over the bus: plainly, or proven by whoever holds the token."""
    address: BusAddress | None = None
    """Where the run was found last."""
    setup: RunSetup | None = None
    state: RunState | None = None
    """The latest; it is None until one came, and old when the run is gone."""
    events: deque[RunEvent] = field(default_factory=lambda: deque(maxlen=EVENTS_KEPT))
    history: RunHistory = field(default_factory=RunHistory)
    problem: str | None = "looking for the run"
    """Why nothing is heard of the run, with the way out, or None."""
    malformed: int = 0
    on_state: list[Callable[[RunState], None]] = field(default_factory=list)
    on_event: list[Callable[[RunEvent], None]] = field(default_factory=list)
    on_setup: list[Callable[[RunSetup], None]] = field(default_factory=list)
    _bus: Bus | None = field(default=None, init=False)
    _heard_s: float | None = field(default=None, init=False)

    def age_s(self) -> float | None:
        """Return how long ago the latest state came, s; None before the first."""
        return None if self._heard_s is None else self.clock.now_s() - self._heard_s

    @property
    def lost(self) -> bool:
        """Whether what is shown is old."""
        age_s = self.age_s()
        return age_s is None or age_s > LOST_S

    @property
    def ended(self) -> bool:
        """Whether the run was told to be over: nothing more is to come."""
        return self.state is not None and self.state.phase in ENDED_PHASES

    def alerts(self) -> list[Alert]:
        """Return what is wrong in the run; first of all, when it is, that nothing is heard of it."""
        told = [] if self.state is None else self.state.alerts
        if not self.lost:
            return list(told)
        age_s = self.age_s()
        if self.ended:
            return [Alert("info", "run", "it has ended", "see its report"), *told]
        text = "nothing heard of the run" + ("" if age_s is None else f" for {age_s:.0f} s: what is shown is old")
        return [Alert("alert", "service", text, self.problem or "check that the service runs"), *told]

    async def command(self, request: ControlRequest) -> ControlReply:
        """Say the operator's word to the relay and return its answer. BusError when nobody answers."""
        if self._bus is None or self.address is None:
            raise BusError(f"the run cannot be reached: {self.problem}")
        key = SwarmKeys(self.address.swarm).control
        payload = await self._bus.ask(key, self.say(self.address.swarm, request))
        try:
            return decode(payload, ControlReply)
        except MalformedMessageError as error:
            raise BusError(f"{key} is answered by something else than this service: {error}") from error

    async def follow(self) -> None:
        """Follow the run until cancelled, and find it again whenever it was lost."""
        while True:
            try:
                address = self.find()
                await self._open_and_attend(address)
            except ServiceError as error:
                self.problem = str(error)
            finally:
                self._bus = None
            await self.clock.sleep(LOOK_S)

    async def _open_and_attend(self, address: BusAddress) -> None:
        try:
            async with self.open_bus(BusEndpoint(address.endpoint, insecure=address.insecure)) as bus:
                await self._attend(bus, address)
        except BusError as error:
            keys = ", and give --keys if it is closed to strangers" if address.endpoint.startswith("tls/") else ""
            self.problem = (
                f"the bus at {address.endpoint} cannot be reached: check that the service runs, and its router{keys}"
            )
            log.debug("%s", error)

    async def _attend(self, bus: Bus, address: BusAddress) -> None:
        """Take in what is said on a bus until the run is somewhere else, or the router is gone."""
        keys = SwarmKeys(address.swarm or await self._only_swarm(bus))
        self._bus, self.address, self.problem = bus, BusAddress(address.endpoint, keys.swarm, address.insecure), None
        bus.subscribe(keys.state, self._take_state)
        bus.subscribe(keys.events, self._take_event)
        while bus.connected() and self.find() == address:
            await self._ask_for_missing(bus, keys)
            await self.clock.sleep(LOOK_S)
        self.problem = f"the bus at {address.endpoint} is gone: tried again"

    async def _only_swarm(self, bus: Bus) -> str:
        """Return the swarm whose run is on a bus. ServiceError when there is none, or several."""
        swarms = sorted(key.split("/")[1] for key in await bus.fetch(SwarmKeys("*").setup))
        if len(swarms) != 1:
            raise ServiceError(
                f"{len(swarms)} runs are on this bus ({', '.join(swarms)}): choose one with --swarm"
                if swarms
                else "no run is on this bus: check --connect, and that the service runs"
            )
        return swarms[0]

    async def _ask_for_missing(self, bus: Bus, keys: SwarmKeys) -> None:
        state = self.state
        if state is not None and (
            self.setup is None or (state.run, state.setup) != (self.setup.run, self.setup.number)
        ):
            for payload in (await bus.fetch(keys.setup)).values():
                self._take_setup(keys.setup, payload)
        if state is not None and state.events > self._next_event:
            await self._ask_for_events(bus, keys)

    @property
    def _next_event(self) -> int:
        return self.events[-1].number + 1 if self.events else 0

    async def _ask_for_events(self, bus: Bus, keys: SwarmKeys) -> None:
        try:
            payload = await bus.ask(keys.events, encode(EventsRequest(self._next_event)))
            events = decode_run(payload, Events).events
        except (BusError, MalformedMessageError) as error:
            log.debug("%s: %s", keys.events, error)
            return
        for event in events:
            self._add(event)

    def _take_state(self, key: str, payload: bytes) -> None:
        try:
            state = decode_run(payload, RunState)
        except MalformedMessageError as error:
            self._complain(key, error)
            return
        known = self.state
        if known is not None and known.run == state.run and state.number < known.number:
            return  # overtaken on its way
        if known is not None and known.run != state.run:
            self._forget()
        self.state, self._heard_s = state, self.clock.now_s()
        self.history.take(state)
        for listener in self.on_state:
            listener(state)

    def _take_event(self, key: str, payload: bytes) -> None:
        try:
            event = decode_run(payload, RunEvent)
        except MalformedMessageError as error:
            self._complain(key, error)
            return
        if event.number <= self._next_event:  # after a gap all are asked for, in order
            self._add(event)

    def _take_setup(self, key: str, payload: bytes) -> None:
        try:
            setup = decode_run(payload, RunSetup)
        except MalformedMessageError as error:
            self._complain(key, error)
            return
        self.setup = setup
        for listener in self.on_setup:
            listener(setup)

    def _add(self, event: RunEvent) -> None:
        run = None if self.state is None else self.state.run
        if event.number < self._next_event or (run is not None and event.run != run):
            return
        self.events.append(event)
        self.history.note(event)
        for listener in self.on_event:
            listener(event)

    def _forget(self) -> None:
        """Begin anew with another run."""
        self.events.clear()
        self.history = RunHistory()
        self.setup = None

    def _complain(self, key: str, error: Exception) -> None:
        self.malformed += 1
        if self.malformed == 1:
            log.warning("%s: a message is not what this version knows: %s", key, error)


@contextlib.asynccontextmanager
async def following(
    find: Callable[[], BusAddress], say: Words = plainly, join: OpenBus = open_bus
) -> AsyncIterator[RunClient]:
    """Follow a run while the block lasts."""
    client = RunClient(find, open_bus=join, say=say)
    async with background(client.follow()):
        yield client
