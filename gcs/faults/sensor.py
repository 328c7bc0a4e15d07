"""A simulated sensor that goes wrong in mid-run, and remembers the truth about what it reported."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from typing import Final

from msgspec.structs import replace

from drivers.aoa.model import SensorModel, SimulatedSensor
from drivers.bus.messages import Bearing, BearingReport
from gcs.faults.fault import Fault, Kind
from planner.angles import wrap

_OVERTAKEN_S: Final = (0.12, 0.4)


class FaultySensor(SimulatedSensor):
    """A sensor with what ails it now, by kind. `muted` are the transmitters that do not transmit, whoever asks."""

    def __init__(self, model: SensorModel, noise: random.Random, seed: str) -> None:
        super().__init__(model, noise)
        self.ails: dict[Kind, Fault] = {}
        self.muted: set[str] = set()
        self.captured_ns: dict[int, int] = {}
        """When each report was truly captured, by its sequence number."""
        self._draws = random.Random(f"{seed}/ailments")  # noqa: S311 - noise, not secrets
        self._true_ns = 0
        self._drift_since_ns = 0
        self._shown: list[Bearing] = []

    def strike(self, fault: Fault) -> None:
        """Let a fault begin."""
        self.ails[fault.kind] = fault
        self._drift_since_ns = self._true_ns

    def measure(
        self, captured_ns: int, own: complex, transmitters: Mapping[str, complex], heading_rad: float = 0.0
    ) -> BearingReport | None:
        """Return the report of one instant as a sensor with these faults makes it."""
        self._true_ns = captured_ns
        heard = {name: place for name, place in transmitters.items() if name not in self.muted}
        report = super().measure(captured_ns, own, heard, heading_rad)
        if report is None or "sensor_silent" in self.ails:
            return None
        bearings = [self._wrong(bearing) for bearing in report.bearings]
        if "sensor_stuck" in self.ails and self._shown:
            bearings = self._shown
        self._shown = bearings
        self.captured_ns[report.sequence] = captured_ns
        return replace(report, bearings=bearings)

    def clock_ns(self, true_ns: int) -> int:
        """Return what this UAV's clock shows at a true time."""
        shown_ns = super().clock_ns(true_ns)
        if (step := self.ails.get("clock_step")) is not None:
            shown_ns += round(step.amount * 1e9)
        if (drift := self.ails.get("clock_drift")) is not None:
            shown_ns += round(drift.amount * (true_ns - self._drift_since_ns))
        return shown_ns

    def delay_s(self) -> float:
        """Return how long after its capture the next report is to arrive, s."""
        delay_s, draws = super().delay_s(), self._draws
        if (delay := self.ails.get("report_delay")) is not None:
            delay_s += delay.amount
        if (jitter := self.ails.get("report_jitter")) is not None:
            delay_s += draws.uniform(0.0, jitter.amount)
        if (late := self.ails.get("report_reordering")) is not None and draws.random() < late.amount:
            delay_s += draws.uniform(*_OVERTAKEN_S)
        return delay_s

    def _wrong(self, bearing: Bearing) -> Bearing:
        off_rad = sum(
            fault.amount
            for kind in ("sensor_bias", "sensor_jump")
            if (fault := self.ails.get(kind)) is not None and fault.of in (None, bearing.transmitter)
        )
        return replace(bearing, azimuth_rad=wrap(bearing.azimuth_rad + off_rad) % math.tau) if off_rad else bearing
