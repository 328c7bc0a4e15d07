"""What is simulated in a run, and the faults that its playbook injects there: real ones, on real processes."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import SensorFault, encode
from drivers.bus.session import Bus
from drivers.clock import Clock
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.impairment import UNIMPAIRED, Impairment
from drivers.simulation.launcher import ProcessGroup
from drivers.simulation.link_tap import LinkTap, open_tap
from gcs.errors import ServiceError
from gcs.playbook.schema import Playbook
from gcs.playbook.stage_rules import ON_THE_LINK
from gcs.playbook.stages import Fault, Inject

ROUTER: Final = "bus-router"
"""What the process of the bus router is called that a run starts."""
PILOTS_MODE: Final = 5
"""LOITER of ArduCopter, and of the embedded copters."""
_PILOTS_STATION: Final = 254
_REBOOTS_ARMED: Final = 20190226
_EMPTY_MAH: Final = 1.0
_FULL_MAH: Final = 5000.0
"""What the battery of a simulated copter holds: it tells what is left of that."""


class Switch(Protocol):
    """Begins a fault of one vehicle or process, or ends it."""

    def __call__(self, name: str, *, on: bool) -> None:
        """Begin, or end."""
        ...


@dataclass(frozen=True)
class Simulation:
    """The simulated part of a run: its processes by name, and a tap on the link of everyone whose link is to fail."""

    group: ProcessGroup
    bus: Bus
    keys: SwarmKeys
    taps: Mapping[str, LinkTap] = field(default_factory=dict)

    def strike(self, fault: Fault, vehicle: str | None, impairment: Impairment = UNIMPAIRED) -> Callable[[], None]:
        """Let a fault happen now; return what ends it. ServiceError when its process has ended already.

        `impairment` is what `link_faults` do to a link.
        """
        switches: dict[Fault, Switch] = {
            "pilot": self._take_over,
            "sensor_silent": self._silence,
            "link_cut": self._cut,
            "link_faults": partial(self._impair, impairment=impairment),
            "freeze": self._freeze,
            "reboot": self._reboot,
            "battery_low": self._drain,
            "router_killed": self._kill,
            "router_frozen": self._freeze,
        }
        name, switch = ROUTER if vehicle is None else vehicle, switches[fault]
        switch(name, on=True)
        return partial(switch, name, on=False)

    def _take_over(self, name: str, *, on: bool) -> None:
        """Have a pilot's own station switch a vehicle to a mode flown by sticks; he keeps it."""
        if on:
            mode = (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, PILOTS_MODE, 0, 0, 0, 0, 0)
            self._command(name, mavlink.MAV_CMD_DO_SET_MODE, mode)

    def _reboot(self, name: str, *, on: bool) -> None:
        """Have another station reboot an autopilot, in the air or not."""
        if on:
            self._command(name, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, (1, 0, 0, 0, 0, _REBOOTS_ARMED, 0))

    def _drain(self, name: str, *, on: bool) -> None:
        """Have another station tell a copter that its battery holds next to nothing, or what it did."""
        system_id, component = self.taps[name].system_id, mavlink.MAV_COMP_ID_AUTOPILOT1
        holds_mah = _EMPTY_MAH if on else _FULL_MAH
        self._speak(
            name,
            mavlink.MAVLink_param_set_message(
                system_id, component, b"BATT_CAPACITY", holds_mah, mavlink.MAV_PARAM_TYPE_INT32
            ),
        )

    def _cut(self, name: str, *, on: bool) -> None:
        self.taps[name].cut = on

    def _impair(self, name: str, *, on: bool, impairment: Impairment) -> None:
        self.taps[name].impairment = impairment if on else UNIMPAIRED

    def _freeze(self, name: str, *, on: bool) -> None:
        self._signal(name, signal.SIGSTOP if on else signal.SIGCONT)

    def _kill(self, name: str, *, on: bool) -> None:
        if on:
            self._signal(name, signal.SIGKILL)

    def _command(self, name: str, number: int, values: tuple[float, ...]) -> None:
        system_id, component = self.taps[name].system_id, mavlink.MAV_COMP_ID_AUTOPILOT1
        self._speak(name, mavlink.MAVLink_command_long_message(system_id, component, number, 0, *values))

    def _speak(self, name: str, message: mavlink.MAVLink_message) -> None:
        station = mavlink.MAVLink(None, _PILOTS_STATION, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self.taps[name].speak(message.pack(station))

    def _silence(self, name: str, *, on: bool) -> None:
        self.bus.put_reliably(self.keys.sensor_fault(name), encode(SensorFault(silent=on)))

    def _signal(self, name: str, number: signal.Signals) -> None:
        process = self.group.processes.get(name)
        if process is None or process.returncode is not None:
            raise ServiceError(f"the process of {name} has ended already, or is not this run's own")
        process.send_signal(number)


@contextlib.asynccontextmanager
async def tapped(
    playbook: Playbook, vehicles: Mapping[str, Vehicle], clock: Clock | None = None
) -> AsyncIterator[dict[str, LinkTap]]:
    """Open a tap on the link of every vehicle whose link the stages of a playbook are going to touch.

    What befalls a link that fails is drawn from the playbook's seed, and timed by the clock, the machine's by default.
    """
    faults = [stage.settings for stage in playbook.flow if isinstance(stage.settings, Inject)]
    struck = {fault.vehicle for fault in faults if fault.fault in ON_THE_LINK}
    async with contextlib.AsyncExitStack() as stack:
        yield {
            name: await stack.enter_async_context(
                open_tap(vehicle.system_id, vehicle.link.address.port, clock, f"{playbook.seed}/{name}")
            )
            for name, vehicle in vehicles.items()
            if name in struck
        }
