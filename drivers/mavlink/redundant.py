"""Several links to one vehicle: all are listened to, one is spoken on (see `path_choice`).

Motions leave on that one alone, for a motion that lies in the queue of another link arrives when it is no longer meant;
stops, and commands that stop, leave on every link, so that in each queue a stop comes last. The lease is not this
module's: on a change of links the latest setpoint goes out again at once, for as long as its own lease lasts.

There is no timer: telemetry on any link, and every setpoint, is an occasion to look whether the link in use is silent.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import Clock
from drivers.errors import LinkError
from drivers.mavlink.codec import Message
from drivers.mavlink.freshness import Freshness, Verdict
from drivers.mavlink.link import Channel, MessageHandler, Setpoint, Subscription
from drivers.mavlink.path_choice import PATIENCE_S, Path, better_path
from drivers.mavlink.transport import LinkAddress

log = logging.getLogger(__name__)

ASK_AGAIN_S: Final = 5.0
"""How often the messages' rates are asked for on a link that tells nothing of use."""
_QUIET_S: Final = 10.0
"""One change of links in this time is a warning, more are for who debugs."""
_TEXTS_KEPT: Final = 16

_ASKING: Final = frozenset({mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_REQUEST_MESSAGE})
_EVENTS: Final = frozenset(
    {mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, mavlink.MAVLINK_MSG_ID_PARAM_VALUE, mavlink.MAVLINK_MSG_ID_STATUSTEXT}
)
"""They tell what was asked for or what happened, not what is: never out of date."""


class RedundantLink:
    """The links to one vehicle as one, the preferred first. Other vehicles may share each of them."""

    def __init__(self, system_id: int, links: Sequence[Channel], clock: Clock) -> None:
        if not links or len(set(map(id, links))) < len(links):
            raise LinkError(f"system id {system_id}: each of a vehicle's links has to be another one")
        self._system_id = system_id
        self._clock = clock
        self._paths = [Path(number, link) for number, link in enumerate(links)]
        self._used = self._paths[0]
        self._changed_s = -math.inf
        self._freshness = Freshness(len(links))
        self._texts = _Texts()
        self._handler: MessageHandler | None = None
        self._setpoint: Setpoint | None = None
        self._answering: dict[int, Path | None] = {}
        """Which link the answer to a command is taken from; None before the first answer to one sent on all."""
        self._rates: dict[float, Message] = {}
        self._rates_asked_s = [-math.inf] * len(links)

    @property
    def address(self) -> LinkAddress:
        """Where the vehicle is spoken to now."""
        return self._used.link.address

    @property
    def heard_system_ids(self) -> frozenset[int]:
        """The systems whose autopilots have been heard on any of the links."""
        return frozenset[int]().union(*(path.link.heard_system_ids for path in self._paths))

    @property
    def contested_system_ids(self) -> frozenset[int]:
        """The system ids that two autopilots have claimed lately on any one of the links."""
        return frozenset[int]().union(*(path.link.contested_system_ids for path in self._paths))

    def listen(self, subscription: Subscription) -> None:
        """Hand the wanted messages of the vehicle's autopilot to its handler; LinkError when a link has it already."""
        self._handler = subscription.handler
        for path in self._paths:
            handler = partial(self._receive, path)
            path.link.listen(Subscription(self._own(subscription.system_id), subscription.message_ids, handler))

    def post(self, message: Message) -> None:
        """Queue an ordinary message on the link in use, and on all what asks for messages: each link has its own."""
        self._choose(self._clock.now_s())
        command = _command_of(message)
        if command in _ASKING:
            if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                self._rates[message.param1] = message
            self._expect_answer(message, None)
            for path in self._paths:
                path.link.post(message)
        else:
            self._expect_answer(message, self._used)
            self._used.link.post(message)

    def post_urgent(self, message: Message) -> None:
        """Queue a command that stops the vehicle on every link."""
        self._expect_answer(message, None)
        for path in self._paths:
            path.link.post_urgent(message)

    def post_setpoint(self, system_id: int, setpoint: Setpoint) -> None:
        """Queue a setpoint on the link in use, one that stops the vehicle on every link."""
        self._own(system_id)
        self._setpoint = setpoint
        self._choose(self._clock.now_s())
        self._send_setpoint()

    def drop_setpoint(self, system_id: int) -> None:
        """Forget a setpoint still waiting anywhere."""
        self._setpoint = None
        for path in self._paths:
            path.link.drop_setpoint(self._own(system_id))

    def _own(self, system_id: int) -> int:
        """Return the system id, which is the vehicle's. LinkError for another one."""
        if system_id != self._system_id:
            raise LinkError(f"{self.address}: this is the way to system id {self._system_id}, not to {system_id}")
        return system_id

    def _send_setpoint(self) -> None:
        """Queue the latest setpoint where it belongs; links let go of one that has expired."""
        if self._setpoint is None:
            return
        for path in self._paths:
            if path is self._used or self._setpoint.stops:
                path.link.post_setpoint(self._system_id, self._setpoint)
            else:
                path.link.drop_setpoint(self._system_id)

    def _choose(self, now_s: float) -> None:
        """Change links when there is a better one."""
        better = better_path(self._paths, self._used, now_s)
        if better is None:
            return
        level = logging.WARNING if now_s - self._changed_s > _QUIET_S else logging.DEBUG
        log.log(level, "system id %d: on %s now, not on %s", self._system_id, better.link.address, self.address)
        self._used, self._changed_s = better, now_s
        self._send_setpoint()

    def _receive(self, path: Path, message: Message) -> None:
        now_s = self._clock.now_s()
        verdict = self._freshness.verdict(path.number, message, now_s)
        if now_s - path.heard_s > PATIENCE_S:
            self._ask_for_rates(path, now_s)
        if verdict is not Verdict.LATE:
            path.hear(now_s)
            self._choose(now_s)
        if self._handler is not None and self._is_news(path, message, verdict):
            self._handler(message)

    def _is_news(self, path: Path, message: Message, verdict: Verdict) -> bool:
        message_id = message.get_msgId()
        if message_id == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            return self._answers(path, message.command)
        if message_id == mavlink.MAVLINK_MSG_ID_STATUSTEXT and self._texts.is_echo(message, path.number):
            return False
        return verdict is Verdict.FRESH or message_id in _EVENTS

    def _expect_answer(self, message: Message, path: Path | None) -> None:
        """Take the answer to a command from one link, or from the first that brings it."""
        if (command := _command_of(message)) is not None:
            self._answering[command] = path

    def _answers(self, path: Path, command: int) -> bool:
        """Return whether a link brings the answer to a command, not one to its copy on another link."""
        if self._answering.get(command) is None:
            self._answering[command] = path
        return self._answering[command] is path

    def _ask_for_rates(self, path: Path, now_s: float) -> None:
        """Ask again for the messages' rates on a link that may not have been there when they were asked for."""
        if now_s - self._rates_asked_s[path.number] > ASK_AGAIN_S:
            self._rates_asked_s[path.number] = now_s
            for message in self._rates.values():
                path.link.post(message)


def _command_of(message: Message) -> int | None:
    command: int | None = getattr(message, "command", None)
    return command


@dataclass
class _Texts:
    """What the autopilot said lately, so that it is said once and not once for each link."""

    _said: deque[tuple[object, int]] = field(default_factory=lambda: deque(maxlen=_TEXTS_KEPT))

    def is_echo(self, message: Message, number: int) -> bool:
        """Return whether another link brought a text already; each repeats it once."""
        text = (message.severity, message.text, message.id, message.chunk_seq)
        for said, by in self._said:
            if said == text and by != number:
                self._said.remove((said, by))
                return True
        self._said.append((text, number))
        return False
