"""The ground-station failsafe of an ArduCopter: what it does when its own station falls silent."""

from __future__ import annotations

from math import inf

from drivers.simulation.flight import CRITICAL, INFO, Flight, Say
from drivers.simulation.modes import PILOTED, Mode

ACTIONS = {
    1: Mode.RTL,
    2: Mode.RTL,
    3: Mode.RTL,  # SmartRTL or RTL: there is no recorded path here
    4: Mode.LAND,  # SmartRTL or LAND
    5: Mode.LAND,
    6: Mode.RTL,
    7: Mode.BRAKE,
}
"""The mode of each value of FS_GCS_ENABLE; 0 is off."""


class GcsFailsafe:
    """Acts FS_GCS_TIMEOUT after the last heartbeat of SYSID_MYGCS; a station never heard never triggers it.

    It leaves the vehicle in its new mode when the station returns, and leaves a piloted mode alone.
    """

    def __init__(self, flight: Flight, say: Say) -> None:
        self.on = False
        self._flight = flight
        self._say = say
        self._heard_s: float | None = None

    @property
    def due_s(self) -> float:
        """When it will act unless a heartbeat comes, s since switch-on."""
        parameters = self._flight.parameters
        if self.on or self._heard_s is None or parameters["FS_GCS_ENABLE"] == 0:
            return inf
        return self._heard_s + parameters["FS_GCS_TIMEOUT"]

    def hear(self, system_id: int) -> None:
        """Take note of a station's heartbeat."""
        if system_id != self._flight.parameters["SYSID_MYGCS"]:
            return
        self._heard_s = self._flight.time_s
        if self.on:
            self.on = False
            self._say(INFO, "GCS Failsafe Cleared")

    def act(self) -> None:
        """Do what FS_GCS_ENABLE says; on the ground that is to disarm."""
        self.on = True
        flight = self._flight
        self._say(CRITICAL, "GCS Failsafe")
        if not flight.armed or flight.mode in PILOTED:
            return
        if flight.landed:
            flight.disarm()
        else:
            flight.enter(ACTIONS[int(flight.parameters["FS_GCS_ENABLE"])])
