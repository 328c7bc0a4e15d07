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
from drivers.simulation.streams import Streams
from drivers.simulation.telemetry import REPORTS, Message, heartbeat
from drivers.simulation.vehicle import Vehicle

COMPONENT_ID = mavlink.MAV_COMP_ID_AUTOPILOT1
UNDERSTOOD = frozenset(HANDLERS)
"""The ids of the messages worth decoding."""


REBOOT_S = 0.6
"""Between a reboot and the clock's new start; the first heartbeat comes a second after that."""


class Autopilot:
    """One ArduCopter: tell it the time and the messages that arrive, and send what its ports hold.

    Times are s since it was first switched on and never run backwards; a reboot restarts its own clock only.
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
        self._name, self._origin, self._parameters = name, origin, parameters
        self._ready_s, self._first_boot_unix_ns, self._seed = ready_s, boot_unix_ns, seed
        self._switch_on(0.0, heading_rad)

    def _switch_on(self, booted_s: float, heading_rad: float) -> None:
        """Begin as after power-up: nothing is kept but the parameters."""
        self._booted_s = booted_s
        self.flight = Flight(self._parameters, self._say, heading_rad, self._ready_s, self._seed)
        self._failsafe = GcsFailsafe(self.flight, self._say)
        boot_unix_ns = self._first_boot_unix_ns + round(booted_s * 1e9)
        self.vehicle = Vehicle(self._name, self.flight, self._failsafe, self._origin, boot_unix_ns)
        self._announced_mode = self.flight.mode
        for port in self.ports:
            port.streams = Streams(self._parameters)

    def open_port(self) -> Port:
        """Return a new link of this autopilot, with the default rates."""
        port = Port(self.flight.parameters, self.flight.time_s, self._say)
        self.ports.append(port)
        return port

    @property
    def next_due_s(self) -> float:
        """When `advance` next has something to send or to decide."""
        streams_s = min((port.streams.next_due_s for port in self.ports), default=inf)
        return self._booted_s + min(self._failsafe.due_s, streams_s)

    def advance(self, now_s: float) -> None:
        """Fly on to a time, and queue the reports due by then."""
        own_s = now_s - self._booted_s
        if self._failsafe.due_s <= own_s:
            self.flight.advance(self._failsafe.due_s)
            self._failsafe.act()
        self.flight.advance(own_s)
        self._announce_mode()
        for port in self.ports:
            for message_id in port.streams.take_due(own_s):
                port.send(REPORTS[message_id](self.vehicle))

    def receive(self, port: Port, message: Message, now_s: float) -> None:
        """Obey and answer a message that arrived on a port; one meant for another is ignored."""
        self.advance(now_s)
        handler = HANDLERS.get(message.get_msgId())
        if now_s < self._booted_s or handler is None:
            return
        if getattr(message, "target_system", 0) not in (0, self.vehicle.system_id):
            return
        if getattr(message, "target_component", 0) not in (0, COMPONENT_ID):
            return
        handler(self.vehicle, port, message)
        self._announce_mode()
        if self.vehicle.reboots:
            self._reboot(now_s)

    def _reboot(self, now_s: float) -> None:
        """Start anew on the ground under where it is: an autopilot that reboots in the air holds nothing up."""
        fallen = self.flight.dynamics
        self._switch_on(now_s + REBOOT_S, fallen.heading_rad)
        self.flight.place(fallen.north.position_m, fallen.east.position_m)

    def _announce_mode(self) -> None:
        """Send a heartbeat at once when the mode has changed."""
        if self.flight.mode is not self._announced_mode:
            self._announced_mode = self.flight.mode
            for port in self.ports:
                port.send(heartbeat(self.vehicle))

    def _say(self, severity: int, text: str) -> None:
        for port in self.ports:
            port.send(status_text(severity, text))
