"""The world of virtual time, told as a run: what screens would be shown of it."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

from drivers.bus.run_messages import RunSetup
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Battery, Heartbeat, Kinematics, Vehicle
from gcs.monitor.run_setup import run_setup
from gcs.monitor.sources import RunSources
from gcs.monitor.timing import Pace
from gcs.playbook.loader import load_playbook
from gcs.relay.records import ReceiverRecord
from gcs.status import RunStatus
from planner.frames import GeodeticPosition
from planner.plan import RelayPlan
from tests.gcs.relay.world import World

PX4, ARDUPILOT, GUIDED = 12, 3, 4


class ToldWorld(World):
    """A world whose run is told; every change of a receiver is said as the service says it."""

    def __init__(self, uavs: int = 8, **options) -> None:
        super().__init__(uavs=uavs, plan=_plan(uavs), **options)
        self.status = RunStatus(self.playbook.name, self.clock, phase="relay", records=self.executor.records)
        self.status.relay = self.executor
        self.setup: RunSetup = run_setup(self.playbook, self.plan, run="run-1", started_ns=self.clock.unix_ns())
        self.sources = RunSources(
            setup=self.setup,
            status=self.status,
            frame=self.frame,
            pace=Pace(self.playbook.flight.speed_mps),
            board=self.score.board,
            feed=self.feed,
        )

    def announced(self, record: ReceiverRecord) -> None:
        super().announced(record)
        self.status.on_air = self.emission.on_air
        self.status.say(
            f"{record.name} {record.state.value}", vehicle=record.name, leg=len(record.legs), state=record.state.value
        )


@functools.cache
def _plan(uavs: int) -> RelayPlan:
    return load_playbook(Path(f"sitl_configs/paper_{uavs}.yaml")).plan()


class Channel:
    """A link nobody speaks on."""

    def __init__(self) -> None:
        self.address = LinkAddress("udpin", "127.0.0.1", 14550)
        self.subscriptions = []

    def listen(self, subscription) -> None:
        self.subscriptions.append(subscription)

    def post(self, message) -> None:
        """Send nothing."""


def vehicle(name: str, clock, system_id: int = 1) -> Vehicle:
    """Return a vehicle that flies in its guided mode, heard of now."""
    made = Vehicle(name, system_id, Channel(), clock)
    telemetry = made.telemetry
    telemetry.last_message_s = clock.now_s()
    telemetry.heartbeat = Heartbeat(clock.now_s(), 2, ARDUPILOT, GUIDED, armed=True, system_status=4)
    telemetry.kinematics = Kinematics(clock.now_s(), GeodeticPosition(-35.0, 149.0, 600.0), (1.0, 0.0, 0.0))
    telemetry.relative_altitude_m = 20.0
    telemetry.estimator_flags = 0x33F
    telemetry.battery = Battery(80, 15.2)
    return made


def in_mode(made: Vehicle, custom_mode: int, autopilot: int = ARDUPILOT) -> None:
    heartbeat = made.telemetry.heartbeat
    made.telemetry.heartbeat = replace(heartbeat, custom_mode=custom_mode, autopilot=autopilot)
