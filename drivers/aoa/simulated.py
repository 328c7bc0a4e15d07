"""Simulated AOA sensors, all in one process of their own.

They take the UAVs' positions and emissions from the bus and put bearing reports on it, like sensors on the UAVs would.
Started with its settings as JSON on standard input: `python -m drivers.aoa.simulated`.
"""

from __future__ import annotations

import asyncio
import heapq
import random
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Literal

import msgspec

from drivers.aoa.clock_answers import answer_clock_pings
from drivers.aoa.model import SensorFaults, SensorModel, SimulatedSensor
from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import (
    BearingReport,
    Emission,
    MalformedMessageError,
    PositionReport,
    SensorFault,
    decode,
    encode,
)
from drivers.bus.security import with_keys
from drivers.bus.session import Bus, BusEndpoint, Handler, open_bus
from drivers.clock import Clock, SystemClock
from drivers.errors import BusError
from drivers.process import until_told_to_stop
from drivers.tasks import background

POSITION_FRESH_NS = 1_000_000_000
"""A UAV whose position is older is not simulated on: it might be anywhere."""


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

    def sensor(self, receiver: str) -> SimulatedSensor:
        """Return the sensor of one receiver."""
        faults = self.faults.get(receiver, SensorFaults())
        model = SensorModel(self.sigma_rad, self.rate_hz, self.latency_s, self.drop_out, self.reference, faults)
        return SimulatedSensor(model, random.Random(f"{self.seed}/{receiver}"))  # noqa: S311 - noise, not secrets


@dataclass
class SensorField:
    """What the sensors know of the world: who stands where, and who is on the air."""

    beacons: dict[str, complex]
    positions: dict[str, PositionReport] = field(default_factory=dict)
    on_air: dict[str, bool] = field(default_factory=dict)
    silenced: dict[str, bool] = field(default_factory=dict)

    def heard(self, name: str, place: Mapping[str, complex]) -> dict[str, complex]:
        """Return the transmitters a receiver hears: everyone emitting but itself."""
        return {other: at for other, at in place.items() if other != name and self.on_air.get(other, False)}

    def places(self, now_ns: int) -> dict[str, complex]:
        """Return where everyone is now, site frame: the last fresh report, carried on with its velocity."""
        places = dict(self.beacons)
        for name, report in self.positions.items():
            age_ns = now_ns - report.time_ns
            if age_ns <= POSITION_FRESH_NS:
                velocity = complex(report.north_mps, report.east_mps)
                places[name] = complex(report.north_m, report.east_m) + velocity * age_ns * 1e-9
        return places

    def heading_rad(self, name: str) -> float:
        """Return where a UAV's nose points; north until it has said."""
        report = self.positions.get(name)
        return 0.0 if report is None or report.heading_rad is None else report.heading_rad

    def take_position(self, key: str, payload: bytes) -> None:
        """Note a PositionReport."""
        if (name := uav_of(key)) is not None:
            self.positions[name] = decode(payload, PositionReport)

    def take_emission(self, key: str, payload: bytes) -> None:
        """Note who is on the air."""
        if (name := uav_of(key)) is not None:
            self.on_air[name] = decode(payload, Emission).on

    def take_fault(self, key: str, payload: bytes) -> None:
        """Note a sensor that is to fall silent, or speak again."""
        if (name := uav_of(key)) is not None:
            self.silenced[name] = decode(payload, SensorFault).silent


async def run_sensors(settings: SensorSettings, bus: Bus, clock: Clock) -> None:
    """Measure and publish for every receiver at the rate, each report after the latency."""
    keys = SwarmKeys(settings.swarm)
    world = SensorField({name: complex(*place) for name, place in settings.beacons.items()})
    bus.subscribe(keys.every_position, tolerant(world.take_position))
    bus.subscribe(keys.every_emission, tolerant(world.take_emission))
    bus.subscribe(keys.every_sensor_fault, tolerant(world.take_fault))
    for key, payload in (await bus.fetch(keys.every_emission)).items():
        if uav_of(key) not in world.on_air:  # what has come by subscription is newer
            tolerant(world.take_emission)(key, payload)
    sensors = {name: settings.sensor(name) for name in settings.receivers}
    answer_clock_pings(bus, keys, {name: _clock_of(sensor, clock) for name, sensor in sensors.items()})
    delayed: list[tuple[float, int, str, BearingReport]] = []
    numbers = count()
    period_s, due_s = 1.0 / settings.rate_hz, clock.now_s()
    while True:
        if clock.now_s() >= due_s:
            due_s = max(due_s + period_s, clock.now_s() - period_s)
            for name, report in _measured(world, sensors, clock):
                arrives_s = clock.now_s() + sensors[name].delay_s()
                heapq.heappush(delayed, (arrives_s, next(numbers), name, report))
        while delayed and delayed[0][0] <= clock.now_s():
            *_, name, report = heapq.heappop(delayed)
            bus.put_latest(keys.bearings(name), encode(report), urgent=True)
        next_s = min(due_s, delayed[0][0]) if delayed else due_s
        await clock.sleep(next_s - clock.now_s())


def _measured(
    world: SensorField, sensors: Mapping[str, SimulatedSensor], clock: Clock
) -> Iterator[tuple[str, BearingReport]]:
    """Yield what every receiver measures now, where it is known to be and is not silenced."""
    places = world.places(clock.unix_ns())
    for name, sensor in sensors.items():
        if name not in places or world.silenced.get(name, False):
            continue
        report = sensor.measure(clock.unix_ns(), places[name], world.heard(name, places), world.heading_rad(name))
        if report is not None:
            yield name, report


def _clock_of(sensor: SimulatedSensor, clock: Clock) -> Callable[[], int]:
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
