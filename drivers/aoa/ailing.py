"""A simulated sensor that goes wrong in mid-run: it says nothing, the same again, or something else than the truth."""

from __future__ import annotations

import math
import random
from collections.abc import Collection, Mapping
from typing import Final

from msgspec.structs import replace

from drivers.aoa.model import SensorModel, SimulatedSensor
from drivers.bus.messages import Ailment, AilmentKind, Bearing, BearingReport
from planner.angles import wrap

_TURNED: Final = frozenset({"sensor_bias", "sensor_jump"})


class AilingSensor(SimulatedSensor):
    """A simulated sensor, and what ails it now. Ailments of one kind add up; two that are equal are one."""

    def __init__(self, model: SensorModel, noise: random.Random) -> None:
        super().__init__(model, noise)
        self.silent = False
        """Whether it says nothing; what it measures meanwhile is lost."""
        self._since_ns: dict[Ailment, int] = {}
        self._shown: list[Bearing] = []

    def suffer(self, ailments: Collection[Ailment], now_ns: int) -> None:
        """Have these ailments from a true time on, and no others; those it had already go on."""
        self._since_ns = {ailment: self._since_ns.get(ailment, now_ns) for ailment in ailments}

    def measure(
        self, captured_ns: int, own: complex, transmitters: Mapping[str, complex], heading_rad: float = 0.0
    ) -> BearingReport | None:
        """Return the report of one instant as a sensor with these ailments makes it."""
        report = super().measure(captured_ns, own, transmitters, heading_rad)
        if report is None or self.silent:
            return None
        bearings = [self._turned(bearing) for bearing in report.bearings]
        if self._has("sensor_stuck") and self._shown:
            bearings = self._shown
        self._shown = bearings
        return replace(report, bearings=bearings)

    def clock_ns(self, true_ns: int) -> int:
        """Return what this UAV's clock shows at a true time."""
        shown_ns = super().clock_ns(true_ns)
        for ailment, since_ns in self._since_ns.items():
            if ailment.kind == "clock_step":
                shown_ns += round(ailment.amount * 1e9)
            elif ailment.kind == "clock_drift":
                shown_ns += round(ailment.amount * (true_ns - since_ns))
        return shown_ns

    def _has(self, kind: AilmentKind) -> bool:
        return any(ailment.kind == kind for ailment in self._since_ns)

    def _turned(self, bearing: Bearing) -> Bearing:
        off_rad = sum(
            ailment.amount
            for ailment in self._since_ns
            if ailment.kind in _TURNED and ailment.of in (None, bearing.transmitter)
        )
        return replace(bearing, azimuth_rad=wrap(bearing.azimuth_rad + off_rad) % math.tau) if off_rad else bearing
