"""Simulated ArduCopters on a bench, each on a link in memory, so that whole flights take no time at all."""

import asyncio

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.autopilot import Autopilot
from drivers.simulation.geodesy import GeoPoint
from drivers.simulation.parameters import Parameters
from drivers.simulation.reception import HANDLERS
from tests.fakes import settle

STATION = 255
SWARM = {"GUID_TIMEOUT": 1, "FS_GCS_ENABLE": 5, "WP_YAW_BEHAVIOR": 0, "GUID_OPTIONS": 4}
SILENT = ("SR0_EXT_STAT", "SR0_POSITION", "SR0_EXTRA1", "SR0_EXTRA2", "SR0_EXTRA3")


class BenchedLink:
    """A channel straight into a simulated copter; `garble` may change, or drop, what the copter sends."""

    def __init__(self, clock, autopilot, system_id):
        self.address = LinkAddress("udpin", "127.0.0.1", 14550)
        self.heard_system_ids = frozenset({system_id})
        self.contested_system_ids = frozenset()
        self.autopilot = autopilot
        self.commands = []
        self.setpoints = []
        self.garble = lambda message: message
        self._clock = clock
        self._started_s = clock.now_s()
        self._system_id = system_id
        self._port = autopilot.open_port()
        self._subscription = None
        self._station = mavlink.MAVLink(None, STATION, 190)
        self._copter = mavlink.MAVLink(None, system_id, 1)

    def listen(self, subscription):
        self._subscription = subscription

    def post(self, message):
        if message.get_type() == "COMMAND_LONG":
            self.commands.append(message.command)
        if message.get_msgId() in HANDLERS:
            arrived = mavlink.MAVLink(None).decode(bytearray(message.pack(self._station)))
            asyncio.get_running_loop().call_soon(self._arrive, arrived)

    def post_urgent(self, message):
        self.post(message)

    def post_setpoint(self, _system_id, setpoint):
        self.setpoints.append(setpoint.message)
        self.post(setpoint.message)

    def drop_setpoint(self, _system_id):
        """Nothing waits here."""

    def _arrive(self, message):
        self.autopilot.receive(self._port, message, self._now_s())
        self.deliver()

    def advance(self):
        self.autopilot.advance(self._now_s())
        self.deliver()

    def deliver(self):
        for message in map(self.garble, self._port.take()):
            if message is not None and message.get_msgId() in self._subscription.message_ids:
                self._subscription.handler(mavlink.MAVLink(None).decode(bytearray(message.pack(self._copter))))

    def _now_s(self):
        return self._clock.now_s() - self._started_s


class Bench:
    """Vehicles by name, on copters of their own."""

    def __init__(self, clock):
        self.clock = clock
        self.vehicles = {}

    def add(self, name, home, *, ready_s=0.0, called=None, **parameters):
        """Put a copter on the bench at a home, GeodeticPosition; `called` is what its number is made from."""
        system_id = len(self.vehicles) + 1
        table = Parameters()
        for parameter, value in {**dict.fromkeys(SILENT, 0), **SWARM, **parameters}.items():
            assert table.set(parameter, value), parameter
        table.set("SYSID_THISMAV", system_id)
        origin = GeoPoint(home.latitude_deg, home.longitude_deg, home.altitude_m)
        autopilot = Autopilot(called or name, origin, table, ready_s=ready_s)
        link = BenchedLink(self.clock, autopilot, system_id)
        self.vehicles[name] = Vehicle(name, system_id, link, self.clock)
        return self.vehicles[name]

    async def until_done(self, task, at_most_s=200.0):
        """Let time pass until a task is done."""
        for _ in range(round(at_most_s / 0.1)):
            await self.pass_time(0.1)
            if task.done():
                return task.result()
        raise AssertionError("not in time")

    async def pass_time(self, duration_s):
        for _ in range(round(duration_s / 0.1)):
            await self.clock.advance(0.1)
            for vehicle in self.vehicles.values():
                vehicle.link.advance()
            await settle()
