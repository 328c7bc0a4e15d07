"""What is simulated in a run, and the faults that its playbook injects there: real ones, on real processes."""

from __future__ import annotations

import cmath
import contextlib
import math
import os
import signal
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.keys import SwarmKeys
from drivers.bus.session import Bus
from drivers.clock import Clock
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.impairment import UNIMPAIRED, Impairment
from drivers.simulation.launcher import ProcessGroup
from drivers.simulation.link_tap import LinkTap, open_tap
from gcs.errors import ServiceError
from gcs.playbook.schema import Playbook
from gcs.playbook.stage_rules import OF_A_SENSOR, OF_A_TRANSMITTER, ON_THE_LINK
from gcs.playbook.stages import Fault, Inject
from gcs.stages.faults_of_sensors import SensorFaults, fault_of
from gcs.stages.full_disk import FullDisk

ROUTER: Final = "bus-router"
"""What the process of the bus router is called that a run starts."""
PILOTS_MODE: Final = 5
"""LOITER of ArduCopter, and of the embedded copters."""
_PILOTS_STATION: Final = 254
_VELOCITY_ONLY: Final = 0x0DC7
"""Of the fields of a setpoint, those that count."""
_REBOOTS_ARMED: Final = 20190226
_EMPTY_MAH: Final = 1.0
_FULL_MAH: Final = 5000.0
"""What the battery of a simulated copter holds: it tells what is left of that."""


End = Callable[[], Awaitable[None]]
"""Ends a fault; it does nothing where that does not end."""


class Switch(Protocol):
    """Begins the fault of a stage, or ends it."""

    async def __call__(self, stage: Inject, /, *, on: bool) -> None:
        """Begin, or end."""
        ...


@dataclass(frozen=True)
class Simulation:
    """The simulated part of a run: its processes by name, and a tap on the link of everyone whose link is to fail."""

    group: ProcessGroup
    bus: Bus
    keys: SwarmKeys
    taps: Mapping[str, LinkTap] = field(default_factory=dict)
    speedup: float = 1.0
    """Of the time that a playbook speaks of."""
    _sensors: SensorFaults = field(init=False)
    _disk: FullDisk = field(default_factory=FullDisk, init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_sensors", SensorFaults(self.bus, self.keys))

    async def strike(self, stage: Inject) -> End:
        """Let a fault happen now; return what ends it. ServiceError, SimulationError when it cannot happen.

        Ending it may raise the same.
        """
        switch = self._switches()[stage.fault]
        await switch(stage, on=True)
        return partial(switch, stage, on=False)

    def _switches(self) -> dict[Fault, Switch]:
        return {
            **dict.fromkeys((*OF_A_SENSOR, *OF_A_TRANSMITTER), self._ail),
            "pilot": self._take_over,
            "transmitter_drift": self._fly_off,
            "telemetry_lost": self._mute,
            "link_cut": self._cut,
            "link_faults": self._impair,
            "freeze": self._freeze,
            "reboot": self._reboot,
            "battery_low": self._drain,
            "router_killed": self._kill_router,
            "router_frozen": self._freeze,
            "service_frozen": self._freeze_this,
            "service_killed": self._kill_this,
            "disk_full": self._fill_disk,
        }

    async def _ail(self, stage: Inject, *, on: bool) -> None:
        self._sensors.switch(_struck(stage), fault_of(stage), on=on)

    async def _take_over(self, stage: Inject, *, on: bool) -> None:
        """Have a pilot's own station switch a vehicle to a mode flown by sticks; he keeps it."""
        if on:
            mode = (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, PILOTS_MODE, 0, 0, 0, 0, 0)
            self._command(stage, mavlink.MAV_CMD_DO_SET_MODE, mode)

    async def _reboot(self, stage: Inject, *, on: bool) -> None:
        """Have another station reboot an autopilot, in the air or not."""
        if on:
            self._command(stage, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, (1, 0, 0, 0, 0, _REBOOTS_ARMED, 0))

    async def _drain(self, stage: Inject, *, on: bool) -> None:
        """Have another station tell a copter that its battery holds next to nothing, or what it did."""
        tap, holds_mah = self.taps[_struck(stage)], _EMPTY_MAH if on else _FULL_MAH
        parameter = (b"BATT_CAPACITY", holds_mah, mavlink.MAV_PARAM_TYPE_INT32)
        told = mavlink.MAVLink_param_set_message(tap.system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, *parameter)
        tap.speak(_said(told))

    async def _fly_off(self, stage: Inject, *, on: bool) -> None:
        """Have another station fly a vehicle with a velocity, in the guided mode that it is in, or no more."""
        tap, velocity = self.taps[_struck(stage)], cmath.rect(stage.speed_mps, math.radians(stage.course_deg))
        place, acceleration, yaw = (0.0,) * 3, (0.0,) * 3, (0.0, 0.0)
        told = mavlink.MAVLink_set_position_target_local_ned_message(
            0,
            *(tap.system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, mavlink.MAV_FRAME_LOCAL_NED, _VELOCITY_ONLY),
            *(*place, velocity.real, velocity.imag, 0.0, *acceleration, *yaw),
        )
        tap.keep_saying(_said(told) if on else None)

    async def _cut(self, stage: Inject, *, on: bool) -> None:
        self.taps[_struck(stage)].cut = on

    async def _mute(self, stage: Inject, *, on: bool) -> None:
        self.taps[_struck(stage)].mute = on

    async def _impair(self, stage: Inject, *, on: bool) -> None:
        self.taps[_struck(stage)].impairment = impairment_of(stage) if on else UNIMPAIRED

    async def _freeze(self, stage: Inject, *, on: bool) -> None:
        self._signal(stage.vehicle or ROUTER, signal.SIGSTOP if on else signal.SIGCONT)

    async def _kill_router(self, _stage: Inject, *, on: bool) -> None:
        """Kill the bus router, or have another one in its place, which knows nothing of what it knew."""
        if on:
            self._signal(ROUTER, signal.SIGKILL)
        else:
            await self.group.restart(ROUTER)

    async def _freeze_this(self, stage: Inject, *, on: bool) -> None:
        """Have this process stopped from outside; it has gone on by itself when this is to end."""
        if on and stage.for_s is not None:
            arguments = [str(os.getpid()), f"{stage.for_s / self.speedup:g}"]
            await self.group.start("freezer", ["-m", "drivers.simulation.freezer", *arguments])

    async def _kill_this(self, _stage: Inject, *, on: bool) -> None:
        if on:
            os.kill(os.getpid(), signal.SIGKILL)

    async def _fill_disk(self, _stage: Inject, *, on: bool) -> None:
        (self._disk.fill if on else self._disk.free)()

    def _command(self, stage: Inject, number: int, values: tuple[float, ...]) -> None:
        tap = self.taps[_struck(stage)]
        told = mavlink.MAVLink_command_long_message(tap.system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, number, 0, *values)
        tap.speak(_said(told))

    def _signal(self, name: str, number: signal.Signals) -> None:
        process = self.group.processes.get(name)
        if process is None or process.returncode is not None:
            raise ServiceError(f"the process of {name} has ended already, or is not this run's own")
        process.send_signal(number)


def impairment_of(stage: Inject) -> Impairment:
    """Return what `link_faults` do to a link."""
    return Impairment(stage.loss, stage.duplication, stage.reordering, stage.delay_s, stage.jitter_s)


def _struck(stage: Inject) -> str:
    """Return whom a fault strikes that strikes somebody."""
    if stage.vehicle is None:
        raise ServiceError(f"{stage.fault} strikes nobody: it names no vehicle")
    return stage.vehicle


def _said(message: mavlink.MAVLink_message) -> bytes:
    """Return a message as another station than the service says it."""
    return bytes(message.pack(mavlink.MAVLink(None, _PILOTS_STATION, mavlink.MAV_COMP_ID_MISSIONPLANNER)))


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
