"""The simulated world with a clock moved by hand, and hooks for what a test does to it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path

from drivers.mavlink.setpoints import StreamState
from gcs.commands.options import changed
from gcs.playbook.loader import load_playbook
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import ReceiverState
from gcs.simulate.vehicle import SimulatedVehicle
from gcs.simulate.world import RelayWorld
from gcs.simulated_vehicles import weather_of
from planner.plan import RelayPlan
from tests.fakes import FakeBus, ManualClock

PERIOD_S = 0.1
LEASE_S = 0.5


class FakeVehicle(SimulatedVehicle):
    """An embedded copter that fails the test when it is told what it must never be told."""

    def __init__(self, *arguments) -> None:
        super().__init__(*arguments)
        self.renewals: list[float] = []
        """When its lease was renewed, s."""
        self._guided = True

    @property
    def guided(self) -> bool:
        """Whether it is in its guided mode."""
        return self._guided

    @guided.setter
    def guided(self, guided: bool) -> None:
        assert guided, "take_over() takes it out of it"
        self._guided = True
        self.give_back()

    def take_over(self) -> None:
        self._guided = False
        super().take_over()

    def renew(self, velocity_north_east_mps: complex) -> None:
        assert self.state is not StreamState.PILOT, "a setpoint for a vehicle its pilot has"
        assert abs(velocity_north_east_mps) <= 5.0 + 1e-9
        super().renew(velocity_north_east_mps)
        self.renewals.append(self._clock.now_s())

    def move(self, duration_s: float) -> None:
        """Be where it is by now."""
        self.advance()


class World(RelayWorld):
    """The paper's UAVs in virtual time. Places are in the site frame; `tamper` may change or drop a report."""

    vehicles: dict[str, FakeVehicle]
    clock: ManualClock
    bus: FakeBus

    def __init__(
        self,
        sigma_deg: float = 0.1,
        seed: int = 1,
        uavs: int = 8,
        plan: RelayPlan | None = None,
        *,
        attended: bool = False,
    ) -> None:
        playbook = changed(load_playbook(Path(f"sitl_configs/paper_{uavs}.yaml")), "sensor", sigma_deg=sigma_deg)
        self.objections: dict[str, str] = {}
        self.history: list[tuple[float, str, ReceiverState, str]] = []
        super().__init__(playbook, plan or playbook.plan(), ManualClock(), FakeBus(), seed=seed, attended=attended)

    def make_vehicle(self, name: str, home: complex) -> FakeVehicle:
        altitude_m, weather = self.playbook.flight.altitude_m, weather_of(self.playbook)
        return FakeVehicle(home, altitude_m, self.limits, self.clock, weather, 0)

    async def run(
        self,
        limit_s: float = 600.0,
        meanwhile: Callable[[float], None] = lambda _: None,
        until: Callable[[], bool] = lambda: False,
    ) -> None:
        """Run the relay to its end, or `until` enough of it was seen.

        `meanwhile` is called with the time since the start before each step; what it has `left` to do has to be done.
        """
        relay = asyncio.create_task(self.executor.run())
        started_s = self.clock.now_s()
        while not relay.done():
            assert self.clock.now_s() < started_s + limit_s, "the relay did not end"
            meanwhile(self.clock.now_s() - started_s)
            self._measure()
            await self.clock.advance(PERIOD_S)
            self.places()
            if until():
                relay.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await relay
        if not relay.cancelled():
            await relay
        assert not getattr(meanwhile, "left", ()), "the script was not played to its end"

    def on_its_way(self, name: str) -> Callable[[], bool]:
        """Return the condition that a receiver has been located and flies: all before it in the chain stand."""
        return lambda: self.executor.records[name].state is ReceiverState.LEG_1

    def states(self) -> dict[str, ReceiverState]:
        return {name: record.state for name, record in self.executor.records.items()}

    def moving(self) -> str:
        """The receiver that has moved last."""
        return max(self.vehicles, key=lambda name: max(self.vehicles[name].renewals, default=0.0))

    def objection(self, name: str) -> str | None:
        return self.objections.get(name)

    def announced(self, record: ReceiverRecord) -> None:
        self._announce(record)

    def _measure(self) -> None:
        self.measure()
        self.deliver()

    def _announce(self, record: ReceiverRecord) -> None:
        self.history.append((self.clock.now_s(), record.name, record.state, record.reason))
