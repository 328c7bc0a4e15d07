"""What an AOA sensor is to the rest of the system: something that runs, and hands over bearing reports."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from drivers.aoa.model import SensorModel
from drivers.bus.messages import BearingReport

__all__ = ["Publish", "Say", "Sensor", "SensorModel"]

Publish = Callable[[BearingReport], None]
"""Takes one report; it returns at once."""

Say = Callable[[str], None]
"""Takes one sentence for whoever looks after the sensor."""


class Sensor(Protocol):
    """Measures bearings on one receiving UAV.

    Capture times are by the clock of the computer it runs on, which is the clock its host answers for.
    """

    @property
    def counts(self) -> Mapping[str, int]:
        """What became of what it read, by name: for the operator."""
        ...

    async def run(self, publish: Publish, say: Say) -> None:
        """Measure until cancelled, or until there is nothing more. What it reads from may come and go."""
        ...
