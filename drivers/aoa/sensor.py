"""What an AOA sensor is to the rest of the system: something that yields bearing reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from drivers.bus.messages import BearingReport


@dataclass(frozen=True)
class SensorModel:
    """How good a simulated sensor is: noise per bearing, rate, delay and the share of reports that get lost."""

    sigma_rad: float
    rate_hz: float = 10.0
    latency_s: float = 0.1
    drop_out: float = 0.0


class Sensor(Protocol):
    """Measures bearings on one receiving UAV."""

    def measure(self, captured_ns: int, own: complex, transmitters: Mapping[str, complex]) -> BearingReport | None:
        """Return the report of one instant, or None when nothing was heard.

        Places are site positions, north + i east, m.
        """
        ...
