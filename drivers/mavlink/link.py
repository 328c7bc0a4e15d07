"""A MAVLink link: one transport, one owner task that sends, and the vehicles behind it.

Nothing but the owner task writes to a link. Urgent messages (hold, land, return, zero velocity) leave ahead of
everything else; of the setpoints for one vehicle only the latest waits.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import Clock
from drivers.errors import LinkError
from drivers.mavlink.codec import Codec, FrameHeader, Message
from drivers.mavlink.transport import LinkAddress, Transport, open_transport
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


@dataclass
class LinkCounters:
    """What passed over a link."""

    received: int = 0
    sent: int = 0
    lost: int = 0


class Link:
    """One link, shared by every vehicle behind it. Made by `open_link`."""

    def __init__(self, codec: Codec) -> None:
        self.counters = LinkCounters()
        self.codec = codec
        self._subscriptions: dict[int, Subscription] = {}
        self._transport: Transport | None = None
        self._urgent: deque[Message] = deque()
        self._ordinary: deque[Message] = deque()
        self._setpoints: dict[int, Setpoint] = {}
        self._wake = asyncio.Event()
        self._next_sequence: dict[tuple[int, int], int] = {}

    @property
    def address(self) -> LinkAddress:
        """Where the link really is."""
        if self._transport is None:
            raise LinkError("the link is not open")
        return self._transport.address

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

    def receive(self, frame: bytearray) -> None:
        """Take one frame in; it is decoded only when the autopilot of a vehicle sent it and somebody wants it."""
        header = FrameHeader.of(frame)
        self._count(header)
        if header.component_id != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return
        subscription = self._subscriptions.get(header.system_id)
        if subscription is None or header.message_id not in subscription.message_ids:
            return
        message = self.codec.decode(frame)
        if message is not None:
            subscription.handler(message)

    async def run(self, transport: Transport, clock: Clock) -> None:
        """Own the link: send what is queued, and this station's heartbeat."""
        self._transport = transport
        async with background(self._heartbeats(clock)):
            while True:
                await self._wake.wait()
                self._wake.clear()
                while (message := self._next(clock.now_s())) is not None:
                    self._send(transport, message)

    def _send(self, transport: Transport, message: Message) -> None:
        try:
            frame = self.codec.encode(message)
        except LinkError as error:
            log.error("%s: %s", transport.address, error)
            return
        transport.send(frame)
        self.counters.sent += 1

    def _next(self, now_s: float) -> Message | None:
        if self._urgent:
            return self._urgent.popleft()
        while self._setpoints:
            system_id = min(self._setpoints, key=lambda waiting: not self._setpoints[waiting].stops)
            setpoint = self._setpoints.pop(system_id)
            if now_s < setpoint.expires_s:
                return setpoint.message
        return self._ordinary.popleft() if self._ordinary else None

    async def _heartbeats(self, clock: Clock) -> None:
        while True:
            self.post(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
                )
            )
            await clock.sleep(HEARTBEAT_PERIOD_S)

    def _count(self, header: FrameHeader) -> None:
        self.counters.received += 1
        source = (header.system_id, header.component_id)
        gap = (header.sequence - self._next_sequence.get(source, header.sequence)) % 256
        if gap < 128:  # a larger gap is an older frame arriving late
            self.counters.lost += gap
            self._next_sequence[source] = (header.sequence + 1) % 256


@contextlib.asynccontextmanager
async def open_link(address: LinkAddress, codec: Codec, clock: Clock) -> AsyncIterator[Link]:
    """Open a link with its owner task; both end with the context. LinkError when it cannot be opened."""
    link = Link(codec)
    async with open_transport(address, link.receive) as transport, background(link.run(transport, clock)):
        await asyncio.sleep(0)  # the owner takes the transport
        yield link
