"""A world in virtual time for the relay executor: vehicles that answer velocity, sensors that see angles."""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from drivers.aoa.sensor import SensorModel
from drivers.aoa.simulated import SimulatedSensor
from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import Emission, decode, encode
from drivers.mavlink.setpoints import StreamState
from gcs.bearings import BearingFeed
from gcs.playbook.loader import load_playbook
from gcs.relay.emission import EmissionControl
from gcs.relay.executor import RelayExecutor
from gcs.relay.records import ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.relay.states import ReceiverState
from planner.plan import RelayPlan
from tests.fakes import FakeBus, ManualClock

PERIOD_S = 0.1
LEASE_S = 0.5
RESPONSE_S = 0.5


@dataclass
class FakeVehicle:
    """A vehicle on a setpoint lease: it follows the commanded velocity with a lag while the lease lasts."""

    clock: ManualClock
    place: complex
    state: StreamState = StreamState.SILENT
    velocity: complex = 0j
    command: complex = 0j
    lease_until_s: float = 0.0
    renewals: list[float] = field(default_factory=list)
    guided: bool = True

    def take_over(self) -> None:
        """Let a pilot have it, who lets it stand."""
        self.state, self.guided, self.command = StreamState.PILOT, False, 0j

    def release(self) -> str | None:
        if self.state is StreamState.PILOT and not self.guided:
            return "switch it to its guided mode"
        if self.state is StreamState.PILOT:
            self.state = StreamState.SILENT
        return None

    def renew(self, velocity_north_east_mps: complex) -> None:
        assert self.state is not StreamState.PILOT, "a setpoint for a vehicle its pilot has"
        assert abs(velocity_north_east_mps) <= 5.0 + 1e-9
        self.state, self.command = StreamState.LEASED, velocity_north_east_mps
        self.lease_until_s = self.clock.now_s() + LEASE_S
        self.renewals.append(self.clock.now_s())

    def stop(self) -> None:
        if self.state is not StreamState.PILOT:
            self.state, self.command = StreamState.STOPPING, 0j

    def move(self, duration_s: float) -> None:
        if self.state is StreamState.LEASED and self.clock.now_s() >= self.lease_until_s:
            self.stop()
        for _ in range(10):
            self.velocity += (self.command - self.velocity) * duration_s / 10 / RESPONSE_S
            self.place += self.velocity * duration_s / 10


class World:
    """The paper's UAVs in virtual time. Places are in the site frame; `tamper` may change or drop a report."""

    def __init__(
        self,
        sigma_deg: float = 0.1,
        seed: int = 1,
        uavs: int = 8,
        plan: RelayPlan | None = None,
        *,
        attended: bool = False,
    ) -> None:
        self.playbook = load_playbook(Path(f"sitl_configs/paper_{uavs}.yaml"))
        self.plan = plan or self.playbook.plan()
        self.frame = self.playbook.site.frame
        self.clock = ManualClock()
        self.bus = FakeBus()
        self.keys = SwarmKeys(self.playbook.name)
        self.vehicles = {
            name: FakeVehicle(self.clock, self.frame.to_site(at)) for name, at in self.playbook.uavs.items()
        }
        model = SensorModel(math.radians(sigma_deg))
        self.sensors = {
            name: SimulatedSensor(model, random.Random(f"{seed}/{name}")) for name in self.playbook.receivers
        }
        self.on_air: set[str] = set()
        self.silenced: set[str] = set()
        self.objections: dict[str, str] = {}
        self.history: list[tuple[float, str, ReceiverState, str]] = []
        self.said: list[str] = []
        self.tamper: Callable[[str, bytes], bytes | None] = lambda _, payload: payload
        self.bus.subscribe(self.keys.every_emission, self._emission)
        self.feed = BearingFeed(self.playbook.receivers, self.frame, self.clock, 0.5)
        self.feed.attach(self.bus, self.keys)
        self.emission = EmissionControl(self.bus, self.keys, self.clock)
        self.executor = RelayExecutor(
            {route.receiver: ReceiverRecord(route) for route in self.plan.routes},
            {name: transmitter.at for name, transmitter in self.playbook.transmitters.items()},
            leases=self.vehicles,
            feed=self.feed,
            emission=self.emission,
            frame=self.frame,
            clock=self.clock,
            settings=RelaySettings(),
            objection=self.objections.get,
            announce=self._announce,
            say=self.said.append,
            problem=self.playbook.problem(),
            attended=attended,
        )

    async def run(self, limit_s: float = 600.0, meanwhile: Callable[[float], None] = lambda _: None) -> None:
        """Run the relay to its end; `meanwhile` is called with the time since the start before each step."""
        relay = asyncio.create_task(self.executor.run())
        started_s = self.clock.now_s()
        while not relay.done():
            assert self.clock.now_s() < started_s + limit_s, "the relay did not end"
            meanwhile(self.clock.now_s() - started_s)
            self._measure()
            await self.clock.advance(PERIOD_S)
            for vehicle in self.vehicles.values():
                vehicle.move(PERIOD_S)
        await relay

    def errors_m(self) -> dict[str, float]:
        """How far each receiver stands from its slot, m."""
        return {
            name: abs(self.frame.from_site(self.vehicles[name].place) - record.route.target)
            for name, record in self.executor.records.items()
        }

    def states(self) -> dict[str, ReceiverState]:
        return {name: record.state for name, record in self.executor.records.items()}

    def moving(self) -> str:
        """The receiver that has moved last."""
        return max(self.vehicles, key=lambda name: max(self.vehicles[name].renewals, default=0.0))

    def _measure(self) -> None:
        places = {name: vehicle.place for name, vehicle in self.vehicles.items()}
        for name, sensor in self.sensors.items():
            if name in self.silenced:
                continue
            heard = {other: places[other] for other in self.on_air if other != name}
            report = sensor.measure(self.clock.unix_ns(), places[name], heard)
            payload = None if report is None else self.tamper(name, encode(report))
            if payload is not None:
                self.bus.put_latest(self.keys.bearings(name), payload, urgent=True)

    def _emission(self, key: str, payload: bytes) -> None:
        name = uav_of(key)
        assert name is not None
        (self.on_air.add if decode(payload, Emission).on else self.on_air.discard)(name)

    def _announce(self, record: ReceiverRecord) -> None:
        self.history.append((self.clock.now_s(), record.name, record.state, record.reason))
