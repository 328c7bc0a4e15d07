"""The MAVLink side of a simulated ArduCopter, without any I/O: messages and simulated time in, messages out."""

from __future__ import annotations

from math import inf

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation.failsafe import GcsFailsafe
from drivers.simulation.flight import Flight
from drivers.simulation.geodesy import GeoPoint
from drivers.simulation.parameters import Parameters
from drivers.simulation.port import Port, status_text
from drivers.simulation.reception import HANDLERS
from drivers.simulation.telemetry import REPORTS, Message, heartbeat
from drivers.simulation.vehicle import Vehicle

COMPONENT_ID = mavlink.MAV_COMP_ID_AUTOPILOT1
UNDERSTOOD = frozenset(HANDLERS)
"""The ids of the messages worth decoding."""


class Autopilot:
    """One ArduCopter: tell it the time and the messages that arrive, and send what its ports hold.

    Times are s since switch-on and never run backwards.
    """

    def __init__(
        self,
        name: str,
        origin: GeoPoint,
        parameters: Parameters,
        *,
        heading_rad: float = 0.0,
        ready_s: float = 0.0,
        boot_unix_ns: int = 0,
        seed: int = 0,
    ) -> None:
        self.ports: list[Port] = []
        self.flight = Flight(parameters, self._say, heading_rad, ready_s, seed)
        self._failsafe = GcsFailsafe(self.flight, self._say)
        self.vehicle = Vehicle(name, self.flight, self._failsafe, origin, boot_unix_ns)
        self._announced_mode = self.flight.mode

    def open_port(self) -> Port:
        """Return a new link of this autopilot, with the default rates."""
        port = Port(self.flight.parameters, self.flight.time_s, self._say)
        self.ports.append(port)
        return port

    @property
    def next_due_s(self) -> float:
        """When `advance` next has something to send or to decide."""
        return min(self._failsafe.due_s, min((port.streams.next_due_s for port in self.ports), default=inf))

    def advance(self, now_s: float) -> None:
        """Fly on to a time, and queue the reports due by then."""
        if self._failsafe.due_s <= now_s:
            self.flight.advance(self._failsafe.due_s)
            self._failsafe.act()
        self.flight.advance(now_s)
        self._announce_mode()
        for port in self.ports:
            for message_id in port.streams.take_due(now_s):
                port.send(REPORTS[message_id](self.vehicle))

    def receive(self, port: Port, message: Message, now_s: float) -> None:
        """Obey and answer a message that arrived on a port; one meant for another is ignored."""
        self.advance(now_s)
        handler = HANDLERS.get(message.get_msgId())
        if handler is None or getattr(message, "target_system", 0) not in (0, self.vehicle.system_id):
            return
        if getattr(message, "target_component", 0) not in (0, COMPONENT_ID):
            return
        handler(self.vehicle, port, message)
        self._announce_mode()

    def _announce_mode(self) -> None:
        """Send a heartbeat at once when the mode has changed."""
        if self.flight.mode is not self._announced_mode:
            self._announced_mode = self.flight.mode
            for port in self.ports:
                port.send(heartbeat(self.vehicle))

    def _say(self, severity: int, text: str) -> None:
        for port in self.ports:
            port.send(status_text(severity, text))
