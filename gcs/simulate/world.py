"""One relay in a world of its own: embedded copters in the air, sensors that see angles, and the service's executor."""

from __future__ import annotations

import asyncio
import heapq
import math
import random
from collections.abc import Callable, Mapping
from functools import partial
from itertools import count
from typing import Final, Literal
from zlib import crc32

from drivers.aoa.clock_answers import answer_clock_pings
from drivers.aoa.model import SimulatedSensor
from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import Emission, decode, encode
from drivers.bus.session import Bus
from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamLimits
from drivers.tasks import background
from gcs.bearings import BearingFeed
from gcs.clock_offsets import ClockOffsets
from gcs.playbook.schema import Playbook
from gcs.recording.score import Score
from gcs.relay.emission import EmissionControl
from gcs.relay.executor import RelayExecutor, Work
from gcs.relay.journey import Journey
from gcs.relay.records import ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.safety import PositionBoard, Safety, SafetyLimits, SitePosition
from gcs.separation import braking_way
from gcs.simulate.paper_journey import fly_as_the_paper
from gcs.simulate.vehicle import SimulatedVehicle
from gcs.simulated_vehicles import weather_of
from gcs.traced_monitor import MonitorNote
from planner.plan import RelayPlan

_SOON_S = 1e-6

Stop = Literal["filtered", "raw"]
"""How legs end: by the service's own monitor, or as in the paper."""
_JOURNEYS: Final[Mapping[Stop, Work]] = {"filtered": Journey.fly, "raw": fly_as_the_paper}


class RelayWorld:
    """Vehicles, sensors and the relay that flies them, in whatever time the clock keeps. Places in the site frame.

    `on_air` are the transmitters that are heard, `silenced` the receivers whose sensors say nothing; `tamper` may
    change or drop a report on its way.
    """

    def __init__(
        self,
        playbook: Playbook,
        plan: RelayPlan,
        clock: Clock,
        bus: Bus,
        *,
        seed: int,
        attended: bool = False,
        stop: Stop = "filtered",
    ) -> None:
        self.playbook, self.plan, self.clock, self.bus, self.seed = playbook, plan, clock, bus, seed
        self.frame = playbook.site.frame
        self.keys = SwarmKeys(playbook.name)
        self.settings = RelaySettings.of(playbook.flight, playbook.planner.min_separation_m)
        self.limits = StreamLimits(lease_s=playbook.flight.lease_s, largest_speed_mps=playbook.flight.speed_mps)
        self.vehicles: Mapping[str, SimulatedVehicle] = {
            name: self.make_vehicle(name, self.frame.to_site(at)) for name, at in playbook.uavs.items()
        }
        self.sensors = {
            name: SimulatedSensor(playbook.sensor.model_of(name), random.Random(f"{seed}/{name}"))  # noqa: S311 - noise
            for name in playbook.receivers
        }
        self.on_air: set[str] = set()
        self.silenced: set[str] = set()
        self.said: list[str] = []
        self.tamper: Callable[[str, bytes], bytes | None] = lambda _, payload: payload
        self._beacons = {name: self.frame.to_site(at) for name, at in playbook.beacons.items()}
        self._on_their_way: list[tuple[float, int, str, bytes]] = []
        self._numbers = count()
        self.clocks = ClockOffsets(playbook.receivers, clock, self.said.append)
        self.feed = BearingFeed(
            playbook.receivers, self.frame, clock, self.settings.gap_s, self.clocks, playbook.sensor.reference
        )
        self.emission = EmissionControl(bus, self.keys, clock)
        records = {route.receiver: ReceiverRecord(route) for route in plan.routes}
        board = PositionBoard()
        self.score = Score(self.frame, board, records)
        transmitters = {name: transmitter.at for name, transmitter in playbook.transmitters.items()}
        self._safety = Safety(
            self.vehicles,
            bus.connected,
            SafetyLimits.of(playbook.flight, playbook.planner.min_separation_m),
            board,
            {name: self.frame.to_site(at) for name, at in transmitters.items()},
        )
        self.executor_of = partial(
            RelayExecutor,
            transmitters=transmitters,
            feed=self.feed,
            emission=self.emission,
            frame=self.frame,
            clock=clock,
            settings=self.settings,
            objection=self.objection,
            announce=self.announced,
            problem=playbook.problem(),
            trace=self.traced,
            attended=attended,
            bring=_JOURNEYS[stop],
        )
        """Makes the executor of a service in this world, from records, leases and who says what it does."""
        self.executor = self.executor_of(records, leases=self.vehicles, say=self.said.append)
        self._join_bus()

    def make_vehicle(self, name: str, home: complex) -> SimulatedVehicle:
        """Return a UAV in the air above `home`."""
        gusts = crc32(f"{self.seed}/{name}/gusts".encode())
        weather = weather_of(self.playbook)
        nose_rad = 0.0
        if self.playbook.sensor.reference == "body":
            start = random.Random(f"{self.seed}/{name}/start")  # noqa: S311 - noise
            nose_rad = start.uniform(0.0, math.tau)
            sigma_m = self.playbook.planner.start_sigma_m if name in self.playbook.receivers else 0.0
            home += complex(start.gauss(0.0, sigma_m), start.gauss(0.0, sigma_m))
        return SimulatedVehicle(
            home, self.playbook.flight.altitude_m, self.limits, self.clock, weather, gusts, nose_rad
        )

    def objection(self, name: str) -> str | None:
        """Return why a vehicle must not move now, or None."""
        return self._safety.objection(name)

    def announced(self, record: ReceiverRecord) -> None:
        """Take note of a receiver's change."""

    def traced(self, receiver: str, note: MonitorNote) -> None:
        """Take note of what a receiver's stop monitor was told or answered."""

    async def run(self, limit_s: float) -> None:
        """Run the relay to its end; TimeoutError when it has not ended by then."""
        async with background(self.clocks.run()):
            await self._until_done(asyncio.create_task(self.executor.run()), self.clock.now_s() + limit_s)

    async def hover(self, duration_s: float) -> None:
        """Let everything go on for a while after the relay's end."""
        await self._until_done(asyncio.create_task(self.clock.sleep(duration_s)), self.clock.now_s() + 2 * duration_s)

    async def _until_done(self, task: asyncio.Task[None], latest_s: float) -> None:
        """Measure at the sensors' rate, and deliver what was measured, until a task is done."""
        period_s, due_s = 1.0 / self.playbook.sensor.rate_hz, self.clock.now_s()
        try:
            while not task.done():
                if self.clock.now_s() > latest_s:
                    raise TimeoutError
                if due_s <= self.clock.now_s() + _SOON_S:
                    self.measure()
                    due_s += period_s
                self.deliver()
                next_s = min([due_s, *(arrives_s for arrives_s, *_ in self._on_their_way[:1])])
                await self.clock.sleep(next_s - self.clock.now_s())
        finally:
            if not task.done():
                task.cancel()
        await task

    def places(self) -> dict[str, complex]:
        """Return where everybody is now, beacons included."""
        for vehicle in self.vehicles.values():
            vehicle.advance()
        return {name: vehicle.place for name, vehicle in self.vehicles.items()} | self._beacons

    def errors_m(self) -> dict[str, float]:
        """Return how far each receiver is from its slot, m."""
        return {
            name: abs(self.frame.from_site(self.vehicles[name].place) - record.route.target)
            for name, record in self.executor.records.items()
        }

    def measure(self) -> None:
        """Let every sensor measure now; the reports are on their way for as long as they take."""
        places, now_s = self.places(), self.clock.now_s()
        for name, vehicle in self.vehicles.items():
            self.score.board.latest[name] = SitePosition(
                now_s, vehicle.place, vehicle.height_m, braking_way(vehicle.velocity)
            )
            self.score.moved(name)
        for name, sensor in self.sensors.items():
            if name in self.silenced:
                continue
            heard = {other: places[other] for other in sorted(self.on_air) if other != name}
            report = sensor.measure(self.clock.unix_ns(), places[name], heard, self.vehicles[name].heading_rad)
            if report is not None:
                arrival = (now_s + sensor.delay_s(), next(self._numbers), name, encode(report))
                heapq.heappush(self._on_their_way, arrival)

    def deliver(self) -> None:
        """Put the reports on the bus that have arrived by now."""
        while self._on_their_way and self._on_their_way[0][0] <= self.clock.now_s() + _SOON_S:
            *_, name, payload = heapq.heappop(self._on_their_way)
            tampered = self.tamper(name, payload)
            if tampered is not None:
                self.bus.put_latest(self.keys.bearings(name), tampered, urgent=True)

    def _join_bus(self) -> None:
        self.bus.subscribe(self.keys.every_emission, self._take_emission)
        self.feed.attach(self.bus, self.keys)
        self.clocks.attach(self.bus, self.keys)
        answer_clock_pings(self.bus, self.keys, {name: self._clock_of(name) for name in self.sensors})

    def _clock_of(self, name: str) -> Callable[[], int]:
        return lambda: self.sensors[name].clock_ns(self.clock.unix_ns())

    def _take_emission(self, key: str, payload: bytes) -> None:
        name = uav_of(key)
        if name is not None:
            (self.on_air.add if decode(payload, Emission).on else self.on_air.discard)(name)
