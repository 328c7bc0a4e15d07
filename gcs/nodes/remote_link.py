"""The service's side of a vehicle's link that is at a node: telemetry comes over the bus, commands leave over it.

No setpoint does: those are made where the link is.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import Clock
from drivers.errors import LinkError, SetpointError
from drivers.mavlink.codec import MAGIC, Codec, FrameHeader, Message
from drivers.mavlink.link import Setpoint, Subscription
from drivers.mavlink.link_status import SILENT_AFTER_S, LinkState, LinkStatus
from drivers.mavlink.transport import LinkAddress

SendFrame = Callable[[bytes, bool], None]
"""Sends a frame to the node, ahead of others when it is urgent."""


class RemoteLink:
    """The way to one vehicle over the bus and its node's link at `address`."""

    def __init__(self, node: str, address: LinkAddress, codec: Codec, clock: Clock, send: SendFrame) -> None:
        self.node = node
        """Where the link is now."""
        self.address = address
        self._codec = codec
        self._clock = clock
        self._send = send
        self._subscription: Subscription | None = None
        self._received = self._sent = self._dropped = 0
        self._last_s = -math.inf

    @property
    def heard_system_ids(self) -> frozenset[int]:
        """The system that is heard, if it is."""
        heard = self._subscription is not None and self._received > 0
        return frozenset({self._subscription.system_id} if heard and self._subscription is not None else ())

    @property
    def contested_system_ids(self) -> frozenset[int]:
        """Nobody: the node hands on what one address says."""
        return frozenset()

    @property
    def wanted(self) -> Subscription:
        """What is to be passed on. LinkError while nobody listens."""
        if self._subscription is None:
            raise LinkError(f"{self.address}: nobody listens to this link")
        return self._subscription

    def listen(self, subscription: Subscription) -> None:
        """Hand the wanted messages of the vehicle to its handler; LinkError when it has one."""
        if self._subscription is not None:
            raise LinkError(f"{self.address}: a vehicle on a node has a link of its own")
        self._subscription = subscription

    def post(self, message: Message) -> None:
        """Send an ordinary message."""
        self._pass(message, urgent=False)

    def post_urgent(self, message: Message) -> None:
        """Send a command that stops the vehicle."""
        self._pass(message, urgent=True)

    def post_setpoint(self, system_id: int, _setpoint: Setpoint) -> None:
        """Refuse: setpoints are made at the node."""
        raise SetpointError(f"system id {system_id} is flown by node {self.node}: no setpoint crosses the bus")

    def drop_setpoint(self, system_id: int) -> None:
        """Do nothing: none waits here."""

    def receive(self, frame: bytes) -> None:
        """Take in a frame as it came to the node."""
        wanted, received = self.wanted, bytearray(frame)
        message = self._codec.decode(received) if _is_of(wanted, received) else None
        if message is None:
            self._dropped += 1
            return
        self._received += 1
        self._last_s = self._clock.now_s()
        wanted.handler(message)

    def status(self, now_s: float) -> LinkStatus:
        """Return how it fares, as far as that can be told from here."""
        silent_for_s = now_s - self._last_s
        silent = LinkState.CONNECTING if silent_for_s == math.inf else LinkState.SILENT
        return LinkStatus(
            address=f"{self.address} of {self.node}",
            state=LinkState.UP if silent_for_s <= SILENT_AFTER_S else silent,
            received=self._received,
            sent=self._sent,
            lost=0,
            refused=0,
            dropped=self._dropped,
            skipped_bytes=0,
            loss_ratio=None,
            silent_for_s=silent_for_s,
            heard_system_ids=tuple(self.heard_system_ids),
            contested_system_ids=(),
        )

    def _pass(self, message: Message, *, urgent: bool) -> None:
        self._sent += 1
        self._send(self._codec.encode(message), urgent)


def _is_of(wanted: Subscription, frame: bytearray) -> bool:
    """Return whether a frame is MAVLink 2, of the autopilot that is listened to, and one of those that are wanted."""
    header = FrameHeader.of(frame)
    return (
        frame[0] == MAGIC
        and header.system_id == wanted.system_id
        and header.component_id == mavlink.MAV_COMP_ID_AUTOPILOT1
        and header.message_id in wanted.message_ids
    )
