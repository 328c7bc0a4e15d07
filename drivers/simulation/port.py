"""One link of an autopilot, without its transport: the rates it keeps and what waits to be sent."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation.flight import Say
from drivers.simulation.parameters import Parameters
from drivers.simulation.streams import Streams
from drivers.simulation.telemetry import Message

TEXT_LENGTH = 50


class Port:
    """Where one link's messages queue; `say` reaches the stations on every link."""

    def __init__(self, parameters: Parameters, now_s: float, say: Say) -> None:
        self.streams = Streams(parameters, now_s)
        self.say = say
        self._waiting: list[Message] = []

    def send(self, message: Message) -> None:
        """Queue a message for this link."""
        self._waiting.append(message)

    def take(self) -> list[Message]:
        """Return what waits to be sent, and forget it."""
        waiting, self._waiting = self._waiting, []
        return waiting


def status_text(severity: int, text: str) -> Message:
    """Return a STATUSTEXT, cut to one message."""
    return mavlink.MAVLink_statustext_message(severity, text.encode()[:TEXT_LENGTH])
