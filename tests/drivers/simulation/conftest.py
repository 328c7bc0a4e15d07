"""A simulated ArduCopter on a bench: messages go in and come out as bytes, time passes by hand."""

import os
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation.airframe import STEP_S
from drivers.simulation.autopilot import COMPONENT_ID, UNDERSTOOD, Autopilot
from drivers.simulation.geodesy import GeoPoint
from drivers.simulation.parameters import Parameters
from drivers.simulation.wire import Codec

SYSTEM_ID = 3
ORIGIN = GeoPoint(-35.363262, 149.165237, 584.0)
VELOCITY_MASK = 0x0DC7
HOLD_NOSE_MASK = 0x05C7
POSITION_MASK = 0x0DF8


@dataclass(frozen=True)
class Sample:
    time_s: float
    north_m: float
    east_m: float
    height_m: float
    north_mps: float
    east_mps: float
    up_mps: float


class Station:
    """A ground station on one port of the autopilot."""

    def __init__(self, bench, system_id):
        self._bench = bench
        self._port = bench.autopilot.open_port()
        self._copter_codec = Codec(UNDERSTOOD, COMPONENT_ID)
        self._encoder = mavlink.MAVLink(None, system_id, 190)
        self._decoder = mavlink.MAVLink(None)
        self.heard = []

    def send(self, message):
        self.send_frame(message.pack(self._encoder))

    def send_frame(self, frame):
        for arrived in self._copter_codec.decode(frame):
            self._bench.autopilot.receive(self._port, arrived, self._bench.now_s)
        self._bench.deliver()

    def listen(self):
        for message in self._port.take():
            frame = self._copter_codec.encode(message, self._bench.autopilot.vehicle.system_id)
            self.heard.append(self._decoder.decode(bytearray(frame)))

    def command(self, number, *parameters, target=SYSTEM_ID):
        """Send a COMMAND_LONG and return the result of its acknowledgement, None without one."""
        self.heard.clear()
        padded = (*parameters, *[0.0] * 7)[:7]
        self.send(mavlink.MAVLink_command_long_message(target, 1, number, 0, *padded))
        acks = [ack for ack in self.all("COMMAND_ACK") if ack.command == number]
        return acks[-1].result if acks else None

    def all(self, name):
        return [message for message in self.heard if message.get_type() == name]

    def last(self, name):
        return self.all(name)[-1]

    def texts(self):
        return [message.text for message in self.all("STATUSTEXT")]

    def heartbeat(self):
        self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3))


class Bench:
    def __init__(self, *, ready_s=0.0, heading_rad=0.0, seed=0, **parameters):
        table = Parameters()
        for name, value in {"SYSID_THISMAV": SYSTEM_ID, **parameters}.items():
            assert table.set(name, value), name
        self.now_s = 0.0
        self.stations = []
        self.autopilot = Autopilot("U1", ORIGIN, table, ready_s=ready_s, heading_rad=heading_rad, seed=seed)
        self.flight = self.autopilot.flight
        self.gcs = self.add_station(255)

    def add_station(self, system_id):
        self.stations.append(Station(self, system_id))
        return self.stations[-1]

    def deliver(self):
        for station in self.stations:
            station.listen()

    def sample(self):
        dynamics = self.flight.dynamics
        north, east, down = dynamics.north, dynamics.east, dynamics.down
        return Sample(
            self.now_s,
            north.position_m,
            east.position_m,
            -down.position_m,
            north.velocity_mps,
            east.velocity_mps,
            -down.velocity_mps,
        )

    def run(self, duration_s, repeat=None, every_s=0.1):
        """Let time pass, repeating a message if one is given; return one sample per step."""
        samples = []
        next_s = self.now_s
        for _ in range(round(duration_s / STEP_S)):
            if repeat is not None and self.now_s >= next_s - 1e-9:
                self.gcs.send(repeat)
                next_s += every_s
            self.now_s = round(self.now_s + STEP_S, 6)
            self.autopilot.advance(self.now_s)
            samples.append(self.sample())
        self.deliver()
        return samples

    def mode(self, number):
        return self.gcs.command(mavlink.MAV_CMD_DO_SET_MODE, 1, number)

    def take_off(self, height_m=30.0, settle_s=30.0):
        assert self.mode(4) == 0
        assert self.gcs.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
        assert self.gcs.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == 0
        self.run(settle_s)
        self.gcs.heard.clear()
        return self


def velocity(north_mps=0.0, east_mps=0.0, down_mps=0.0, *, frame=1, mask=VELOCITY_MASK, target=SYSTEM_ID, yaw_rate=0.0):
    """Return a velocity setpoint, m/s."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, target, 1, frame, mask, 0, 0, 0, north_mps, east_mps, down_mps, 0, 0, 0, 0, yaw_rate
    )


def position(north_m, east_m, down_m, *, frame=1):
    """Return a position setpoint, m."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, SYSTEM_ID, 1, frame, POSITION_MASK, north_m, east_m, down_m, 0, 0, 0, 0, 0, 0, 0, 0
    )


@pytest.fixture
def make_bench():
    """How to put a copter on the bench: keyword arguments are ArduPilot parameters, `ready_s`, `heading_rad`."""
    return Bench


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def airborne():
    return Bench().take_off()


@pytest.fixture(name="velocity")
def velocity_fixture():
    return velocity


@pytest.fixture(name="position")
def position_fixture():
    return position


def free_port():
    """Return a UDP port that nobody had a moment ago."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Observer:
    """Somebody who only listens on one link of a copter process, and remembers."""

    def __init__(self, local_port=0):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", local_port))
        self._decoder = mavlink.MAVLink(None)
        self.port = self._socket.getsockname()[1]
        self.latest = {}
        self.texts = []
        self.sender = None

    @property
    def mode(self):
        return self.latest["HEARTBEAT"].custom_mode

    @property
    def armed(self):
        return bool(self.latest["HEARTBEAT"].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def height_m(self):
        return self.latest["GLOBAL_POSITION_INT"].relative_alt / 1000

    def announce_to(self, port):
        """Speak to a link that waits for someone to speak first."""
        greeting = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_ONBOARD_CONTROLLER, 8, 0, 0, 4, 3)
        self._socket.sendto(greeting.pack(mavlink.MAVLink(None, 77, 1)), ("127.0.0.1", port))

    def wait(self, holds, timeout_s=10.0):
        """Listen until something holds and return True, or return False after a time."""
        deadline = time.monotonic() + timeout_s
        while (left_s := deadline - time.monotonic()) > 0:
            self._socket.settimeout(left_s)
            try:
                datagram, self.sender = self._socket.recvfrom(2048)
            except TimeoutError:
                return False
            message = self._decoder.decode(bytearray(datagram))
            self.latest[message.get_type()] = message
            if message.get_type() == "STATUSTEXT":
                self.texts.append(message.text)
            if {"HEARTBEAT", "GLOBAL_POSITION_INT"} <= self.latest.keys() and holds(self):
                return True
        return False

    def close(self):
        self._socket.close()


@pytest.fixture
def make_observer():
    with ExitStack() as stack:

        def make(local_port=0):
            observer = Observer(local_port)
            stack.callback(observer.close)
            return observer

        yield make


@pytest.fixture
def start_copter():
    """How to start a copter process: its links, then any further arguments."""
    with ExitStack() as stack:

        def start(links, *arguments):
            command = [sys.executable, "-m", "drivers.simulation.copter", "--name", "U1", "--system-id", "3"]
            command += [part for link in links for part in ("--link", link)]
            command += ["--home", "-35.363262,149.165237,584,90", "--parent-pid", str(os.getpid()), *arguments]
            process = stack.enter_context(
                subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            )
            stack.callback(process.kill)
            return process

        yield start


@pytest.fixture(name="free_port")
def free_port_fixture():
    return free_port
