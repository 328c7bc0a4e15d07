"""Simulated AOA sensors, all in one process of their own.

They take the UAVs' positions and emissions from the bus and put bearing reports on it, like sensors on the UAVs would.
Started with its settings as JSON on standard input: `python -m drivers.aoa.simulated`.
"""

from __future__ import annotations

import asyncio
import heapq
import sys
from collections.abc import Callable, Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import Literal

import msgspec

from drivers.aoa.clock_answers import answer_clock_pings
from drivers.aoa.model import SensorFaults, SensorModel
from drivers.aoa.reporting import ReportingSensor
from drivers.aoa.sensor_field import SensorField
from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import BearingReport, MalformedMessageError, encode
from drivers.bus.security import with_keys
from drivers.bus.session import Bus, BusEndpoint, Handler, open_bus
from drivers.clock import Clock, SystemClock
from drivers.errors import BusError
from drivers.process import until_told_to_stop
from drivers.tasks import background

_LOOK_S = 0.5
"""How often it is looked whether the bus is there."""


class SensorSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the sensor process is told on standard input."""

    swarm: str
    endpoint: str
    receivers: list[str]
    beacons: dict[str, tuple[float, float]]
    """Transmitters that report no position: name -> north, east, m."""
    sigma_rad: float
    rate_hz: float
    latency_s: float
    drop_out: float
    seed: int
    speedup: float
    epoch_ns: int
    parent_pid: int
    reference: Literal["true_north", "body"] = "true_north"
    faults: dict[str, SensorFaults] = {}
    """By receiver; those not named have none."""
    keys: str | None = None
    """The service's file of keys, where the bus is closed to strangers."""
    insecure: bool = False
    """Whether it is meant that strangers can join the bus."""
    resolution_rad: float = 0.0
    """What bearings are rounded to; 0: they are not."""

    def sensor(self, receiver: str) -> ReportingSensor:
        """Return the sensor of one receiver."""
        faults = self.faults.get(receiver, SensorFaults())
        model = SensorModel(
            self.sigma_rad, self.rate_hz, self.latency_s, self.drop_out, self.reference, faults, self.resolution_rad
        )
        return ReportingSensor(model, f"{self.seed}/{receiver}")


async def run_sensors(settings: SensorSettings, bus: Bus, clock: Clock) -> None:
    """Measure and publish for every receiver at the rate, each report after the latency."""
    keys = SwarmKeys(settings.swarm)
    world = SensorField({name: complex(*place) for name, place in settings.beacons.items()})
    sensors = {name: settings.sensor(name) for name in settings.receivers}

    def take_fault(key: str, payload: bytes) -> None:
        world.take_fault(key, payload)
        if (name := uav_of(key)) in sensors:
            sensors[name].suffer_all(world.wrong[name], clock.unix_ns())

    takers = {keys.every_emission: tolerant(world.take_emission), keys.every_sensor_fault: tolerant(take_fault)}
    bus.subscribe(keys.every_position, tolerant(world.take_position))
    for key_expression, take in takers.items():
        bus.subscribe(key_expression, take)
    await _catch_up(bus, world, takers)
    answer_clock_pings(bus, keys, {name: _clock_of(sensor, clock) for name, sensor in sensors.items()})
    async with background(_keep_up(bus, world, takers, clock)):
        await _measure(settings.rate_hz, bus, keys, world, sensors, clock)


async def _measure(
    rate_hz: float, bus: Bus, keys: SwarmKeys, world: SensorField, sensors: Mapping[str, ReportingSensor], clock: Clock
) -> None:
    delayed: list[tuple[float, int, str, BearingReport]] = []
    numbers = count()
    period_s, due_s = 1.0 / rate_hz, clock.now_s()
    while True:
        if clock.now_s() >= due_s:
            due_s = max(due_s + period_s, clock.now_s() - period_s)
            for name, report in _measured(world, sensors, clock):
                for arrives_after_s in sensors[name].arrivals_s():
                    heapq.heappush(delayed, (clock.now_s() + arrives_after_s, next(numbers), name, report))
        while delayed and delayed[0][0] <= clock.now_s():
            *_, name, report = heapq.heappop(delayed)
            bus.put_latest(keys.bearings(name), encode(report), urgent=True)
        next_s = min(due_s, delayed[0][0]) if delayed else due_s
        await clock.sleep(next_s - clock.now_s())


def _measured(
    world: SensorField, sensors: Mapping[str, ReportingSensor], clock: Clock
) -> Iterator[tuple[str, BearingReport]]:
    """Yield what every receiver measures now, where it is known to be."""
    places = world.places(clock.unix_ns())
    for name, sensor in sensors.items():
        if name not in places:
            continue
        heard, heading_rad = world.heard(name, places), world.heading_rad(name)
        report = sensor.measure(clock.unix_ns(), places[name], heard, heading_rad)
        if report is not None:
            yield name, report


async def _keep_up(bus: Bus, world: SensorField, takers: Mapping[str, Handler], clock: Clock) -> None:
    """Ask again for what was told while the bus was gone, until somebody answers who may be back later."""
    behind = False
    while True:
        await clock.sleep(_LOOK_S)
        if not bus.connected():
            behind = True
        elif behind:
            behind = not await _catch_up(bus, world, takers)


async def _catch_up(bus: Bus, world: SensorField, takers: Mapping[str, Handler]) -> bool:
    """Ask for what was told last, and take it but where something newer has come; return whether anybody answered."""
    world.told.clear()
    answered = False
    for key_expression, take in takers.items():
        for key, payload in (await bus.fetch(key_expression)).items():
            answered = True
            if key not in world.told:
                take(key, payload)
    return answered


def _clock_of(sensor: ReportingSensor, clock: Clock) -> Callable[[], int]:
    return lambda: sensor.clock_ns(clock.unix_ns())


def tolerant(take: Handler) -> Handler:
    """Return the handler with malformed messages dropped: a stranger's payload ends no sensor."""

    def drop_malformed(key: str, payload: bytes) -> None:
        try:
            take(key, payload)
        except MalformedMessageError:
            return

    return drop_malformed


async def _serve(settings: SensorSettings) -> None:
    clock = SystemClock(settings.speedup, settings.epoch_ns)
    way_in = BusEndpoint(settings.endpoint, insecure=settings.insecure)
    endpoint = with_keys(way_in, Path(settings.keys) if settings.keys else None)
    async with open_bus(endpoint) as bus, background(run_sensors(settings, bus, clock)):
        await until_told_to_stop(settings.parent_pid)


def main() -> int:
    """Run until told to stop; 2 when the bus cannot be reached."""
    settings = msgspec.json.decode(sys.stdin.buffer.read(), type=SensorSettings)
    try:
        asyncio.run(_serve(settings))
    except BusError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
