"""A swarm in one process, for benchmarks of a service: it reports bearings, moves as it is told, and times what comes.

Its vehicles report in turn, so that the load is even. The time of a setpoint is the kernel's when it arrives.
"""

from __future__ import annotations

import cmath
import math
import random
import select
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

import zenoh
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.aoa.model import SensorModel, SimulatedSensor
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import BearingReport
from planner.frames import FormationFrame, GeodeticPosition
from planner.plan import Leg

RATE_HZ: Final = 10.0
KEYS: Final = SwarmKeys("bench")
FRAME: Final = FormationFrame(math.radians(90.0))
ORIGIN: Final = GeodeticPosition(47.4, 8.5, 430.0)
TRANSMITTERS: Final = {"L0": 0j, "L1": complex(200.0)}
ALTITUDE_M: Final = 20.0
SIGMA_RAD: Final = math.radians(0.1)
RESPONSE_S: Final = 0.5
_SO_TIMESTAMPNS: Final = 35
_HEADER: Final = 10
_VELOCITY_AT: Final = 16
_TARGET_AT: Final = 50
"""Of SET_POSITION_TARGET_LOCAL_NED: where vx and vy, and the system meant, stand in the payload."""
_LAST_BEARING_S: Final = 0.2
_DEG_PER_M: Final = 1.0 / 111_195.0

Put = Callable[[int, BearingReport], None]
"""Gets the report of one vehicle when it is due."""


@dataclass(frozen=True)
class Arrival:
    """One datagram as it came; of a setpoint also whose it is."""

    datagram: bytes
    time_ns: int
    number: int | None = None

    @property
    def velocity(self) -> complex | None:
        """What a MAVLink setpoint asks for, m/s; None of one that only looks like it."""
        if self.number is None or self.datagram[0] != mavlink.PROTOCOL_MARKER_V2:
            return None
        return complex(*struct.unpack_from("<ff", self.datagram, _HEADER + _VELOCITY_AT))


def leg_between(start: complex, end: complex) -> Leg:
    """Return the leg from one point to another on a line through L0."""
    stop_angle_rad = cmath.phase((TRANSMITTERS["L1"] - end) / (TRANSMITTERS["L0"] - end))
    return Leg("L0", "away" if abs(end) > abs(start) else "towards", ("L0", "L1"), stop_angle_rad, start, end)


def start_of(number: int, count: int) -> complex:
    """Return where a vehicle stands at first."""
    return cmath.rect(60.0 + 0.5 * number, 0.3 + 2.5 * number / count)


def a_setpoint(number: int) -> bytes:
    """Return a datagram like a setpoint for one vehicle, without what makes it MAVLink."""
    made = bytearray(_HEADER + _TARGET_AT + 5)
    made[_HEADER + _TARGET_AT] = number
    return bytes(made)


@contextmanager
def timed_socket() -> Iterator[socket.socket]:
    """Open a UDP socket on loopback whose datagrams the kernel times."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        opened.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
        yield opened


def arrival_at(port_in: socket.socket) -> tuple[Arrival, tuple[str, int]]:
    """Return the next datagram at a timed socket, and who sent it."""
    datagram, ancillary, _, sender = port_in.recvmsg(512, 64)
    seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
    number = datagram[_HEADER + _TARGET_AT] if len(datagram) > _HEADER + _TARGET_AT else None
    return Arrival(datagram, seconds * 1_000_000_000 + nanoseconds, number), sender


def bearing_publisher(session: zenoh.Session, number: int) -> zenoh.Publisher:
    """Return what puts the reports of one vehicle on the bus, as its sensor would."""
    return session.declare_publisher(
        KEYS.bearings(f"U{number}"),
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.INTERACTIVE_HIGH,
        express=True,
    )


@dataclass
class Swarm:
    """`count` vehicles behind one UDP socket. `take` gets every datagram; with `positions` they tell where they are."""

    count: int
    port_in: socket.socket
    take: Callable[[Arrival], None]
    positions: bool = False
    places: dict[int, complex] = field(init=False)
    """Site frame, m."""
    commands: dict[int, complex] = field(init=False)
    answering: tuple[str, int] = ("", 0)
    """Where the service is."""

    def __post_init__(self) -> None:
        numbers = range(1, self.count + 1)
        self.places = {number: FRAME.to_site(start_of(number, self.count)) for number in numbers}
        self.commands = dict.fromkeys(numbers, 0j)
        self._velocities = dict.fromkeys(numbers, 0j)
        self._transmitters = {name: FRAME.to_site(at) for name, at in TRANSMITTERS.items()}
        model = SensorModel(SIGMA_RAD)
        self._sensors = {n: SimulatedSensor(model, random.Random(f"1/U{n}")) for n in numbers}
        self._senders = {n: mavlink.MAVLink(None, n, mavlink.MAV_COMP_ID_AUTOPILOT1) for n in numbers}
        self._switched_on_s = time.monotonic()
        self._next, self._reported_s = 1, -math.inf

    def fly(self, duration_s: float, put: Put) -> None:
        """Report for a while, each vehicle at its rate and from where the last flight left it."""
        started_s, period_s, turn = time.monotonic(), 1.0 / RATE_HZ / self.count, 0
        while (now_s := time.monotonic()) < started_s + duration_s:
            due_s = started_s + turn * period_s
            if now_s < due_s:
                self.listen(due_s - now_s)
                continue
            turn += 1
            number = self._next
            self._next = number % self.count + 1
            put(number, self._measured(number))
            if self.positions:
                self._say(number, self._position(number))
            if turn % round(RATE_HZ) == 0:  # each vehicle's heartbeat comes once a second, at its own time
                beating = turn // round(RATE_HZ) % self.count + 1
                self._say(beating, self._heartbeat())

    def meet(self) -> None:
        """Wait for the first word of whoever is to answer: it is spoken to from then on."""
        _, self.answering = arrival_at(self.port_in)

    def beat(self) -> None:
        """Let every vehicle say at once that it is there, in its guided mode."""
        for number in self.places:
            self._say(number, self._heartbeat())

    def listen(self, duration_s: float = _LAST_BEARING_S) -> None:
        """Take what comes for a while, and move by it."""
        until_s = time.monotonic() + duration_s
        while (left_s := until_s - time.monotonic()) > 0.0 and select.select([self.port_in], [], [], left_s)[0]:
            arrival, _ = arrival_at(self.port_in)
            velocity = arrival.velocity
            if velocity is not None and arrival.number is not None:
                self.commands[arrival.number] = velocity
            self.take(arrival)

    def _measured(self, number: int) -> BearingReport:
        period_s = 1.0 / RATE_HZ
        follow = 1.0 - math.exp(-period_s / RESPONSE_S)
        self._velocities[number] += (self.commands[number] - self._velocities[number]) * follow
        self.places[number] += self._velocities[number] * period_s
        report = self._sensors[number].measure(time.time_ns(), self.places[number], self._transmitters)
        assert report is not None
        return report

    def _say(self, number: int, message: mavlink.MAVLink_message) -> None:
        sender = self._senders[number]
        self.port_in.sendto(bytes(message.pack(sender)), self.answering)
        sender.seq = (sender.seq + 1) % 256

    def _position(self, number: int) -> mavlink.MAVLink_message:
        place, velocity = self.places[number], self._velocities[number]
        latitude_deg = ORIGIN.latitude_deg + place.real * _DEG_PER_M
        longitude_deg = ORIGIN.longitude_deg + place.imag * _DEG_PER_M / math.cos(math.radians(ORIGIN.latitude_deg))
        return mavlink.MAVLink_global_position_int_message(
            round((time.monotonic() - self._switched_on_s) * 1e3),
            *(round(latitude_deg * 1e7), round(longitude_deg * 1e7)),
            *(round((ORIGIN.altitude_m + ALTITUDE_M) * 1e3), round(ALTITUDE_M * 1e3)),
            *(round(velocity.real * 100.0), round(velocity.imag * 100.0), 0, 0),
        )

    @staticmethod
    def _heartbeat() -> mavlink.MAVLink_message:
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            mavlink.COPTER_MODE_GUIDED,
            mavlink.MAV_STATE_ACTIVE,
            3,
        )
