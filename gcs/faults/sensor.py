"""The sensor of a campaign: it goes wrong as its faults say, its reports come late, and it remembers the truth."""

from __future__ import annotations

import random
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, get_args

from drivers.aoa.ailing import AilingSensor
from drivers.aoa.model import SensorModel
from drivers.bus.messages import Ailment, AilmentKind, BearingReport
from gcs.faults.fault import Fault, Kind

_OVERTAKEN_S: Final = (0.12, 0.4)
_AILMENTS: Final[Mapping[Kind, AilmentKind]] = MappingProxyType({kind: kind for kind in get_args(AilmentKind)})
"""The faults that ail the sensor itself, by the names that they have there, too."""


class FaultySensor(AilingSensor):
    """A sensor with its faults by kind. `muted` are the transmitters that do not transmit, whoever asks."""

    def __init__(self, model: SensorModel, noise: random.Random, seed: str) -> None:
        super().__init__(model, noise)
        self.muted: set[str] = set()
        self.captured_ns: dict[int, int] = {}
        """When each report was truly captured, by its sequence number."""
        self._faults: dict[Kind, Fault] = {}
        self._draws = random.Random(f"{seed}/ailments")  # noqa: S311 - noise, not secrets
        self._true_ns = 0

    def strike(self, fault: Fault) -> None:
        """Let a fault begin; one of its kind ends that was there before."""
        self._faults[fault.kind] = fault
        self._fall_ill()

    def mend(self, kind: Kind) -> None:
        """Let the fault of a kind end."""
        self._faults.pop(kind, None)
        self._fall_ill()

    def measure(
        self, captured_ns: int, own: complex, transmitters: Mapping[str, complex], heading_rad: float = 0.0
    ) -> BearingReport | None:
        """Return the report of one instant as a sensor with these faults makes it."""
        self._true_ns = captured_ns
        heard = {name: place for name, place in transmitters.items() if name not in self.muted}
        report = super().measure(captured_ns, own, heard, heading_rad)
        if report is not None:
            self.captured_ns[report.sequence] = captured_ns
        return report

    def delay_s(self) -> float:
        """Return how long after its capture the next report is to arrive, s."""
        delay_s, draws = super().delay_s(), self._draws
        if (delay := self._faults.get("report_delay")) is not None:
            delay_s += delay.amount
        if (jitter := self._faults.get("report_jitter")) is not None:
            delay_s += draws.uniform(0.0, jitter.amount)
        if (late := self._faults.get("report_reordering")) is not None and draws.random() < late.amount:
            delay_s += draws.uniform(*_OVERTAKEN_S)
        return delay_s

    def _fall_ill(self) -> None:
        self.silent = "sensor_silent" in self._faults
        ailments = [
            Ailment(_AILMENTS[kind], fault.amount, fault.of)
            for kind, fault in self._faults.items()
            if kind in _AILMENTS
        ]
        self.suffer(ailments, self._true_ns)
