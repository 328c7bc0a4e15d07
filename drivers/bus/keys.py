"""Key expressions on the bus: everything lives under bearing-relay/{swarm}/."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

_ROOT: Final = "bearing-relay"
NAME_PATTERN: Final = r"[A-Za-z0-9][A-Za-z0-9_.-]*"
"""What a swarm or a UAV may be called: one chunk of a key expression."""


@dataclass(frozen=True)
class SwarmKeys:
    """The keys of one swarm. `every_...` are key expressions that match all its UAVs."""

    swarm: str

    def bearings(self, uav: str) -> str:
        """Key of a receiver's BearingReports."""
        return f"{_ROOT}/{self.swarm}/uav/{uav}/bearings"

    def position(self, uav: str) -> str:
        """Key of a UAV's PositionReports."""
        return f"{_ROOT}/{self.swarm}/uav/{uav}/position"

    def emission(self, uav: str) -> str:
        """Key of whether a UAV should transmit; its last value can be queried."""
        return f"{_ROOT}/{self.swarm}/uav/{uav}/emission"

    def sensor_fault(self, uav: str) -> str:
        """Key of a fault injected into a simulated sensor; real sensors do not listen to it."""
        return f"{_ROOT}/{self.swarm}/simulation/{uav}/sensor"

    @property
    def every_bearings(self) -> str:
        """Every receiver's BearingReports."""
        return self.bearings("*")

    @property
    def every_position(self) -> str:
        """Every UAV's PositionReports."""
        return self.position("*")

    @property
    def every_emission(self) -> str:
        """Every UAV's emission."""
        return self.emission("*")

    @property
    def every_sensor_fault(self) -> str:
        """Every fault for simulated sensors."""
        return self.sensor_fault("*")

    @property
    def progress(self) -> str:
        """Key of the relay's progress: every state change, every leg; its history can be queried."""
        return f"{_ROOT}/{self.swarm}/relay/progress"

    @property
    def control(self) -> str:
        """Key that answers a ControlRequest with a ControlReply."""
        return f"{_ROOT}/{self.swarm}/relay/control"

    @property
    def setup(self) -> str:
        """Key of what the run is about, RunSetup; its last value can be queried."""
        return f"{_ROOT}/{self.swarm}/relay/setup"

    @property
    def state(self) -> str:
        """Key of the RunStates, of which only the latest counts.

        No wildcard matches a chunk that begins with @: whoever records everything said in a swarm is spared what only
        repeats it.
        """
        return f"{_ROOT}/{self.swarm}/relay/@state"

    @property
    def events(self) -> str:
        """Key of the RunEvents; it answers an EventsRequest with Events."""
        return f"{_ROOT}/{self.swarm}/relay/@events"

    def clock_ping(self, uav: str) -> str:
        """Key of the ClockPings to a UAV's sensor."""
        return f"{_ROOT}/{self.swarm}/uav/{uav}/clock_ping"

    def clock_pong(self, uav: str) -> str:
        """Key of the sensor's ClockPongs."""
        return f"{_ROOT}/{self.swarm}/uav/{uav}/clock_pong"

    @property
    def every_clock_ping(self) -> str:
        """Every sensor's ClockPings."""
        return self.clock_ping("*")

    @property
    def every_clock_pong(self) -> str:
        """Every sensor's ClockPongs."""
        return self.clock_pong("*")


_UAV_KEY = re.compile(rf"{_ROOT}/{NAME_PATTERN}/(?:uav|simulation)/({NAME_PATTERN})/\w+")


def uav_of(key: str) -> str | None:
    """Return the UAV a key speaks for, or None when it speaks for none."""
    match = _UAV_KEY.fullmatch(key)
    return match[1] if match else None
