"""One receiver's simulated sensor with everything that can be wrong in mid-run, and how its reports arrive."""

from __future__ import annotations

import random

from drivers.aoa.ailing import AilingSensor
from drivers.aoa.model import SensorModel
from drivers.bus.messages import SensorFault
from drivers.simulation.impairment import UNIMPAIRED, Impairment


class ReportingSensor(AilingSensor):
    """A sensor whose reports may get lost on their way, come again, or late; all is drawn from the seed."""

    def __init__(self, model: SensorModel, seed: str) -> None:
        super().__init__(model, random.Random(seed))  # noqa: S311 - noise, not secrets
        self._fates = random.Random(f"{seed}/reports")  # noqa: S311 - noise, not secrets
        self._impairment = UNIMPAIRED

    def suffer_all(self, fault: SensorFault, now_ns: int) -> None:
        """Have all that is wrong from a true time on, and nothing else."""
        self.silent = fault.silent
        self.suffer(fault.ailments, now_ns)
        self._impairment = Impairment(fault.loss, fault.duplication, fault.reordering, fault.delay_s, fault.jitter_s)

    def arrivals_s(self) -> list[float]:
        """Return how long after its capture each copy of the next report arrives, s; none when it gets lost."""
        delay_s = self.delay_s()
        return [delay_s + late_s for late_s in self._impairment.arrivals_s(self._fates)]
