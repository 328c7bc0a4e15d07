"""Puts the run before its screens, over the bus: its setup once, its state a few times a second, every event.

It costs the flight as good as nothing, and whatever goes wrong with it ends no flight: nothing waits, states are
dropped where somebody does not keep up, and screens that miss events ask for them again.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections import deque
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from typing import Final

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import MalformedMessageError, encode
from drivers.bus.run_messages import EVENTS_KEPT, EventsRequest, RunEvent, decode_run
from drivers.bus.session import Bus
from drivers.clock import Clock, SystemClock
from drivers.mavlink.codec import Message
from drivers.mavlink.vehicle import Vehicle
from drivers.tasks import background
from gcs.monitor.sources import RunSources
from gcs.monitor.state import StateTeller
from gcs.status import Said

log = logging.getLogger(__name__)

PERIOD_S: Final = 0.2
SHORTEST_S: Final = 0.05
"""However much happens, states are not told more often."""
_HEADING_UNKNOWN_CDEG: Final = 65535
_RAD_PER_CDEG: Final = math.pi / 18_000.0


@dataclass
class Publisher:
    """Publishes one run. `pace` is the machine's time, whatever time the run keeps."""

    bus: Bus
    keys: SwarmKeys
    sources: RunSources
    pace: Clock = field(default_factory=SystemClock)
    _events: deque[tuple[int, bytes]] = field(default_factory=lambda: deque(maxlen=EVENTS_KEPT))
    _happened: asyncio.Event = field(default_factory=asyncio.Event)
    _failed: bool = False

    def __post_init__(self) -> None:
        self._teller = StateTeller(self.sources)

    async def run(self) -> None:
        """Publish until cancelled. Never raises: what is wrong with a screen must not end a flight."""
        while True:
            self._happened.clear()
            try:
                self.publish()
            except Exception:  # noqa: BLE001 - whatever it is
                self._complain("the state of the run could not be told; the flight goes on")
            await self.pace.sleep(SHORTEST_S)
            await self._happened_within(PERIOD_S - SHORTEST_S)

    def publish(self) -> None:
        """Publish the state of the run now, and its setup when that is another one."""
        setup = self.sources.plan_setup()
        if setup is not self.sources.setup:
            self.sources.setup = setup
            self._put_setup()
        self.bus.put_latest(self.keys.state, encode(self._teller.tell()))

    def begin(self) -> None:
        """Publish what the run is about, and answer for its events from now on."""
        self._put_setup()
        self.bus.serve(self.keys.events, self._answer)
        self.sources.status.on_said.append(self.take)

    def end(self) -> None:
        """Publish the last state, and no more events."""
        self.sources.status.on_said.remove(self.take)
        with contextlib.suppress(Exception):  # the bus may be what has failed
            self.publish()

    def take(self, said: Said) -> None:
        """Publish a message of the run as an event, and its state at once."""
        try:
            event = self._event(said)
            payload = encode(event)
            self._events.append((event.number, payload))
            self.bus.put_latest(self.keys.events, payload)
        except Exception:  # noqa: BLE001 - whatever it is
            self._complain("an event of the run could not be told; the flight goes on")
        self._happened.set()

    def _complain(self, words: str) -> None:
        """Log a failure in full once; it would come again five times a second."""
        log.log(logging.DEBUG if self._failed else logging.ERROR, "%s", words, exc_info=not self._failed)
        self._failed = True

    def _put_setup(self) -> None:
        """Let it be fetched. No screen subscribes to it: a value that must arrive would wait for one that is stuck."""
        self.bus.put_reliably(self.keys.setup, encode(self.sources.setup))

    def _event(self, said: Said) -> RunEvent:
        status = self.sources.status
        return RunEvent(
            run=self.sources.setup.run,
            number=status.said - 1,
            time_ns=status.clock.unix_ns(),
            elapsed_s=said.elapsed_s,
            text=said.text,
            level=said.level,
            vehicle=said.vehicle,
            leg=said.leg,
            state=said.state,
        )

    def _answer(self, payload: bytes) -> bytes:
        """Return the events that an EventsRequest asks for; every one was encoded when it happened."""
        try:
            first = decode_run(payload, EventsRequest).first if payload else 0
        except MalformedMessageError:
            first = 0
        asked = [msgspec.Raw(event) for number, event in self._events if number >= first]
        return msgspec.json.encode({"events": asked})

    async def _happened_within(self, duration_s: float) -> None:
        timer = asyncio.ensure_future(self.pace.sleep(duration_s))
        happened = asyncio.ensure_future(self._happened.wait())
        try:
            await asyncio.wait((timer, happened), return_when=asyncio.FIRST_COMPLETED)
        finally:
            timer.cancel()
            happened.cancel()


@contextlib.asynccontextmanager
async def published(bus: Bus, keys: SwarmKeys, sources: RunSources, pace: Clock | None = None) -> AsyncIterator[None]:
    """Keep a run before its screens while the block lasts."""
    publisher = Publisher(bus, keys, sources, pace or SystemClock())
    headings_rad: dict[str, float] = {}
    sources.headings_rad = headings_rad
    with _headings_heard(sources, headings_rad):
        publisher.begin()
        try:
            async with background(publisher.run()):
                yield
        finally:
            publisher.end()


@contextlib.contextmanager
def _headings_heard(sources: RunSources, headings_rad: dict[str, float]) -> Iterator[None]:
    """Note where the vehicles' noses point, while the block lasts."""
    with contextlib.ExitStack() as stack:
        for name, vehicle in sources.vehicles.items():
            stack.enter_context(_heading_heard(name, vehicle, headings_rad))
        yield


def _heading_heard(
    name: str, vehicle: Vehicle, headings_rad: dict[str, float]
) -> contextlib.AbstractContextManager[None]:
    def hear(message: Message) -> None:
        if message.hdg != _HEADING_UNKNOWN_CDEG:
            headings_rad[name] = message.hdg * _RAD_PER_CDEG

    return vehicle.hearing(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, hear)
