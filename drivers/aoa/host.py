"""Runs one sensor on the UAV's companion computer: its reports on the bus, answers for its clock, and how it does."""

from __future__ import annotations

from typing import Final

from drivers.aoa.clock_answers import answer_clock_pings
from drivers.aoa.sensor import Say, Sensor
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import BearingReport, encode
from drivers.bus.session import Bus
from drivers.clock import Clock
from drivers.tasks import background

TOLD_EVERY_S: Final = 10.0


class SensorHost:
    """One sensor on the bus of its swarm, speaking for one UAV."""

    def __init__(self, sensor: Sensor, uav: str, keys: SwarmKeys, bus: Bus, clock: Clock) -> None:
        self._sensor = sensor
        self._uav = uav
        self._keys = keys
        self._bus = bus
        self._clock = clock
        self._published = 0

    async def run(self, say: Say) -> None:
        """Run the sensor until it ends or this is cancelled."""
        answer_clock_pings(self._bus, self._keys, {self._uav: self._clock.unix_ns})
        async with background(self._tell(say)):
            await self._sensor.run(self._publish, say)
        say(self.summary())

    def summary(self) -> str:
        """Return what became of everything so far, in a line."""
        counted = [f"{count} {what.replace('_', ' ')}" for what, count in sorted(self._sensor.counts.items()) if count]
        return ", ".join([f"{self._uav}: {self._published} reports published", *counted])

    def _publish(self, report: BearingReport) -> None:
        self._published += 1
        self._bus.put_latest(self._keys.bearings(self._uav), encode(report), urgent=True)

    async def _tell(self, say: Say) -> None:
        while True:
            await self._clock.sleep(TOLD_EVERY_S)
            lost = "" if self._bus.connected() else " (the bus cannot be reached)"
            say(self.summary() + lost)
