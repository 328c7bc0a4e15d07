"""Locating one receiver while it hovers: what is switched on for it, what it hears then, and where that puts it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from gcs.bearings import Observation, Observations
from gcs.errors import HoldRequiredError
from gcs.relay.emission import EmissionControl
from gcs.relay.locating import hear, locate, too_few, transmitters_to_hear
from gcs.relay.standing import Standing
from gcs.stop_monitor import StopMonitor
from planner.errors import PlannerError
from planner.positioning import Fix


class NoWayError(HoldRequiredError):
    """There is no way on from where the receiver is: no route to its slot, or too little to locate it by."""


@dataclass(frozen=True)
class Lookout:
    """Looks for one receiver. `objection` says why it must not move now, or None: then what it hears does not count.

    `patience_s` is for how long it waits for that to end, and for reports. Directions are `heading_referenced`, or from
    its nose.
    """

    receiver: str
    standing: Standing
    emission: EmissionControl
    observations: Observations
    objection: Callable[[], str | None]
    clock: Clock
    patience_s: float
    heading_referenced: bool

    async def locate(
        self,
        needed: Collection[str],
        samples: int,
        prior: complex,
        covariance: NDArray[np.float64] | None,
        monitor: StopMonitor | None = None,
    ) -> Fix:
        """Locate the receiver that hovers near `prior`, known with a covariance, m^2, or hardly.

        It hears the transmitters `needed` and what sharpens the fix, `samples` times each. A stop monitor is told what
        is heard for it. HoldRequiredError when bearings do not fix its place.
        """
        standing, from_north = self.standing, self.heading_referenced
        names = transmitters_to_hear(prior, needed, standing.places, heading_referenced=from_north)
        if len(names) < 2:
            raise NoWayError(f"it takes two transmitters to be located, and there is {', '.join(names) or 'none'} left")
        self.emission.need(self.receiver, names)
        heard = await self._heard(names, samples)
        if monitor is not None:
            for observation in heard:
                monitor.observe(
                    observation.captured_s,
                    observation.directions_rad,
                    observation.sigma_rad,
                    observation.resolution_rad,
                )
        if few := too_few(heard, names, samples):
            raise HoldRequiredError(
                f"only {min(few.values())} of {samples} reports with bearings of {', '.join(few)}: "
                "check its sensor and the transmitters"
            )
        try:
            places = {name: standing.places[name] for name in sorted(names)}
            return locate(heard, places, standing.sigma_m, prior, covariance, heading_referenced=from_north)
        except PlannerError as error:
            raise HoldRequiredError(f"it could not be located: {error}") from error

    async def _heard(self, names: Collection[str], samples: int) -> list[Observation]:
        """Return what is heard while nothing forbids it to move; heard anew when something did.

        HoldRequiredError when that lasts for as long as a leg would wait.
        """
        since_s: float | None = None
        while True:
            self.observations.forget()
            heard = await hear(self.observations, names, samples, self.patience_s)
            if (objection := self.objection()) is None:
                return heard
            since_s = self.clock.now_s() if since_s is None else since_s
            if self.clock.now_s() - since_s >= self.patience_s:
                raise HoldRequiredError(objection)
