"""A MAVLink link: one transport, one owner task that sends, and the vehicles behind it.

Nothing but the owner task writes to a link. Urgent messages (hold, land, return, zero velocity) leave ahead of
everything else; of the setpoints for one vehicle only the latest waits.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections import deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import Clock
from drivers.errors import LinkError
from drivers.mavlink.codec import Codec, Message
from drivers.mavlink.link_status import SILENT_AFTER_S, LinkCounters, LinkState, LinkStatus, Reception
from drivers.mavlink.tlog import FrameLog
from drivers.mavlink.transport import LinkAddress, Transport
from drivers.mavlink.transports import open_transport
from drivers.tasks import background

log = logging.getLogger(__name__)

HEARTBEAT_PERIOD_S = 1.0

MessageHandler = Callable[[Message], None]


@dataclass(frozen=True)
class Subscription:
    """Which messages of which system go where."""

    system_id: int
    message_ids: frozenset[int]
    handler: MessageHandler


@dataclass(frozen=True)
class Setpoint:
    """A setpoint waiting to be sent: never after `expires_s`, and before others when it stops its vehicle."""

    message: Message
    expires_s: float
    stops: bool


class Channel(Protocol):
    """The way to a vehicle: one link, or several to choose from."""

    @property
    def address(self) -> LinkAddress:
        """Where the vehicle is spoken to now."""
        ...

    @property
    def heard_system_ids(self) -> frozenset[int]:
        """The systems whose autopilots have been heard here."""
        ...

    @property
    def contested_system_ids(self) -> frozenset[int]:
        """The system ids that two autopilots have claimed here lately."""
        ...

    def listen(self, subscription: Subscription) -> None:
        """Hand the wanted messages of one system's autopilot to its handler; LinkError when the system id is taken."""
        ...

    def post(self, message: Message) -> None:
        """Queue an ordinary message: commands, requests, heartbeats."""
        ...

    def post_urgent(self, message: Message) -> None:
        """Queue a command that stops a vehicle: it leaves before everything that waits."""
        ...

    def post_setpoint(self, system_id: int, setpoint: Setpoint) -> None:
        """Queue a setpoint; it replaces one still waiting for the same vehicle."""
        ...

    def drop_setpoint(self, system_id: int) -> None:
        """Forget a setpoint still waiting for a vehicle."""
        ...


class Link:
    """One link, shared by every vehicle behind it. Made by `open_link`."""

    def __init__(self, codec: Codec, clock: Clock, frame_log: FrameLog | None = None) -> None:
        self.counters = LinkCounters()
        self.codec = codec
        self._clock = clock
        self._frame_log = frame_log
        self._reception = Reception(self.counters)
        self._heard_system_ids: set[int] = set()
        self._subscriptions: dict[int, Subscription] = {}
        self._transport: Transport | None = None
        self._urgent: deque[Message] = deque()
        self._ordinary: deque[Message] = deque()
        self._setpoints: dict[int, Setpoint] = {}
        self._wake = asyncio.Event()

    @property
    def address(self) -> LinkAddress:
        """Where the link really is."""
        return self._opened().address

    @property
    def heard_system_ids(self) -> frozenset[int]:
        """The systems whose autopilots have been heard."""
        return frozenset(self._heard_system_ids)

    @property
    def contested_system_ids(self) -> frozenset[int]:
        """The system ids that two autopilots have claimed lately, as far as their addresses tell."""
        return self._opened().contested_system_ids

    def listen(self, subscription: Subscription) -> None:
        """Hand the wanted messages of one system's autopilot to its handler; LinkError when the system id is taken."""
        system_id = subscription.system_id
        if system_id in self._subscriptions:
            raise LinkError(f"{self.address}: two vehicles with system id {system_id}: give each its own SYSID_THISMAV")
        self._subscriptions[system_id] = subscription

    def post(self, message: Message) -> None:
        """Queue an ordinary message: commands, requests, heartbeats."""
        self._ordinary.append(message)
        self._wake.set()

    def post_urgent(self, message: Message) -> None:
        """Queue a command that stops a vehicle: it leaves before everything that waits."""
        self._urgent.append(message)
        self._wake.set()

    def post_setpoint(self, system_id: int, setpoint: Setpoint) -> None:
        """Queue a setpoint; it replaces one still waiting for the same vehicle."""
        self._setpoints[system_id] = setpoint
        self._wake.set()

    def drop_setpoint(self, system_id: int) -> None:
        """Forget a setpoint still waiting for a vehicle."""
        self._setpoints.pop(system_id, None)

    def status(self, now_s: float) -> LinkStatus:
        """Return how the link fares, `now_s` by the clock it was opened with."""
        transport, counters = self._opened(), self.counters
        silent_for_s = now_s - self._reception.last_s
        return LinkStatus(
            address=str(transport.address),
            state=_state(transport, silent_for_s),
            received=counters.received,
            sent=counters.sent,
            lost=counters.lost,
            refused=counters.refused + transport.refused,
            dropped=counters.dropped,
            skipped_bytes=transport.skipped_bytes,
            loss_ratio=self._reception.loss_ratio(now_s),
            silent_for_s=silent_for_s,
            heard_system_ids=tuple(sorted(self._heard_system_ids)),
            contested_system_ids=tuple(sorted(transport.contested_system_ids)),
        )

    def receive(self, frame: bytearray) -> bool:
        """Take one frame in; False when it is refused, its sender not being who it says.

        It is decoded only when the autopilot of a vehicle sent it and somebody wants it.
        """
        if not self.codec.accepts(frame):
            self.counters.refused += 1
            return False
        sequence, system_id, component_id = frame[4], frame[5], frame[6]
        self._reception.count(system_id << 8 | component_id, sequence, self._clock.now_s())
        if self._frame_log is not None:
            self._frame_log.received(frame)
        if component_id != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return True
        self._heard_system_ids.add(system_id)
        subscription = self._subscriptions.get(system_id)
        if subscription is None or int.from_bytes(frame[7:10], "little") not in subscription.message_ids:
            return True
        message = self.codec.decode(frame)
        if message is not None:
            subscription.handler(message)
        return True

    async def run(self, transport: Transport) -> None:
        """Own the link: send what is queued, and this station's heartbeat."""
        self._transport = transport
        async with background(self._heartbeats()):
            while True:
                await self._wake.wait()
                self._wake.clear()
                while (message := self._next(transport)) is not None:
                    self._send(transport, message)

    def _send(self, transport: Transport, message: Message) -> None:
        try:
            frame = self.codec.encode(message)
        except LinkError as error:
            log.error("%s: %s", transport.address, error)
            return
        if not transport.send(frame, getattr(message, "target_system", 0)):
            self.counters.dropped += 1
            return
        self.counters.sent += 1
        if self._frame_log is not None:
            self._frame_log.sent(frame)

    def _next(self, transport: Transport) -> Message | None:
        if self._urgent:
            return self._urgent.popleft()
        while self._setpoints:
            system_id = min(self._setpoints, key=lambda waiting: not self._setpoints[waiting].stops)
            setpoint = self._setpoints.pop(system_id)
            if self._clock.now_s() < setpoint.expires_s and (setpoint.stops or not transport.backlogged):
                return setpoint.message
            self.counters.dropped += 1
        return self._ordinary.popleft() if self._ordinary else None

    async def _heartbeats(self) -> None:
        while True:
            self.post(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
                )
            )
            await self._clock.sleep(HEARTBEAT_PERIOD_S)

    def _opened(self) -> Transport:
        if self._transport is None:
            raise LinkError("the link is not open")
        return self._transport


def _state(transport: Transport, silent_for_s: float) -> LinkState:
    if silent_for_s <= SILENT_AFTER_S and transport.connected:
        return LinkState.UP
    if silent_for_s == math.inf:
        return LinkState.CONNECTING
    return LinkState.SILENT if transport.connected else LinkState.DOWN


@contextlib.asynccontextmanager
async def open_link(
    address: LinkAddress, codec: Codec, clock: Clock, frame_log: FrameLog | None = None
) -> AsyncIterator[Link]:
    """Open a link with its owner task; both end with the context. LinkError when it cannot be opened.

    `frame_log` gets every frame accepted, and every frame sent.
    """
    link = Link(codec, clock, frame_log)
    async with open_transport(address, link.receive) as transport, background(link.run(transport)):
        await asyncio.sleep(0)  # the owner takes the transport
        yield link
