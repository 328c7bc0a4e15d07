"""What is simulated in a run, and the faults that its playbook injects there: real ones, on real processes."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import SensorFault, encode
from drivers.bus.session import Bus
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import ProcessGroup
from drivers.simulation.link_tap import LinkTap, open_tap
from gcs.errors import ServiceError
from gcs.playbook.schema import Playbook
from gcs.playbook.stages import Fault, Inject

ROUTER: Final = "bus-router"
"""What the process of the bus router is called that a run starts."""
PILOTS_MODE: Final = 5
"""LOITER of ArduCopter, and of the embedded copters."""
_PILOTS_STATION: Final = 254
_TAPPED: Final = frozenset({"pilot", "link_cut"})


@dataclass(frozen=True)
class Simulation:
    """The simulated part of a run: its processes by name, and a tap on the link of everyone whose link is to fail."""

    group: ProcessGroup
    bus: Bus
    keys: SwarmKeys
    taps: Mapping[str, LinkTap] = field(default_factory=dict)

    def strike(self, fault: Fault, vehicle: str | None) -> Callable[[], None]:
        """Let a fault happen now; return what ends it. ServiceError when its process has ended already."""
        name = ROUTER if fault == "router_killed" or vehicle is None else vehicle
        if fault == "pilot":
            self._take_over(name)
            return _nothing
        if fault == "link_cut":
            self.taps[name].cut = True
            return lambda: setattr(self.taps[name], "cut", False)
        if fault == "sensor_silent":
            self._silence(name, silent=True)
            return lambda: self._silence(name, silent=False)
        if fault == "freeze":
            self._signal(name, signal.SIGSTOP)
            return lambda: self._signal(name, signal.SIGCONT)
        self._signal(name, signal.SIGKILL)
        return _nothing

    def _take_over(self, name: str) -> None:
        """Have a pilot's own station switch a vehicle to a mode flown by sticks."""
        station = mavlink.MAVLink(None, _PILOTS_STATION, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        mode = (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, PILOTS_MODE, 0, 0, 0, 0, 0)
        number = mavlink.MAV_CMD_DO_SET_MODE
        message = mavlink.MAVLink_command_long_message(
            self.taps[name].system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, number, 0, *mode
        )
        self.taps[name].speak(message.pack(station))

    def _silence(self, name: str, *, silent: bool) -> None:
        self.bus.put_reliably(self.keys.sensor_fault(name), encode(SensorFault(silent=silent)))

    def _signal(self, name: str, number: signal.Signals) -> None:
        process = self.group.processes.get(name)
        if process is None or process.returncode is not None:
            raise ServiceError(f"the process of {name} has ended already, or is not this run's own")
        process.send_signal(number)


@contextlib.asynccontextmanager
async def tapped(playbook: Playbook, vehicles: Mapping[str, Vehicle]) -> AsyncIterator[dict[str, LinkTap]]:
    """Open a tap on the link of every vehicle whose link the stages of a playbook are going to touch."""
    faults = [stage.settings for stage in playbook.flow if isinstance(stage.settings, Inject)]
    struck = {fault.vehicle for fault in faults if fault.fault in _TAPPED}
    async with contextlib.AsyncExitStack() as stack:
        yield {
            name: await stack.enter_async_context(open_tap(vehicle.system_id, vehicle.link.address.port))
            for name, vehicle in vehicles.items()
            if name in struck
        }


def _nothing() -> None:
    """End what does not end."""
