"""What a simulated AOA sensor reports: the truth, after everything that happens to it in a real one.

Pure and seeded. Noise and each fault draw from random streams of their own: a fault that is switched on or off leaves
all the others as they were, and a sensor without faults measures what it always did.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import msgspec

from drivers.bus.messages import LEAST_SIGMA_RAD, Bearing, BearingReport
from planner.angles import direction, wrap

MULTIPATH_JUMPS_RAD = tuple(
    (math.radians(low), math.radians(high)) for low, high in ((9.0, 12.0), (45.0, 45.0), (180.0, 180.0))
)
"""How far a reflection throws a bearing to either side: from, to."""


class Episodes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Something that comes and goes: it begins `every_s` after its last end, on average, and lasts `for_s`."""

    every_s: float
    for_s: float


class ClockFault(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a UAV's clock is off: ahead by `offset_s`, gaining `drift_ppm`, and set forward by `step_s` in mid-run."""

    offset_s: float = 0.0
    drift_ppm: float = 0.0
    step_s: float = 0.0
    step_after_s: float = 30.0

    def shown_ns(self, true_ns: int, since_ns: int) -> int:
        """Return what the clock shows at `true_ns`, having run since `since_ns`."""
        ran_s = (true_ns - since_ns) * 1e-9
        ahead_s = self.offset_s + self.drift_ppm * 1e-6 * ran_s + (self.step_s if ran_s >= self.step_after_s else 0.0)
        return true_ns + round(ahead_s * 1e9)


class SensorFaults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is wrong with one simulated sensor. Shares are of bearings; by transmitter where the name says so."""

    bias_rad: float = 0.0
    """Array mounting or compass: turns every bearing, clockwise."""
    transmitter_bias_rad: dict[str, float] = {}
    transmitter_sigma_rad: dict[str, float] = {}
    """Noise of those transmitters, instead of the sensor's own."""
    outlier_share: float = 0.0
    outlier_jumps_rad: tuple[tuple[float, float], ...] = MULTIPATH_JUMPS_RAD
    bearing_drop_out: float = 0.0
    gaps: Episodes | None = None
    """No report at all."""
    stuck: Episodes | None = None
    """Report after report with the bearings of the last one before."""
    latency_jitter_s: float = 0.0
    """Up to this much is added to the latency of each report: they may overtake each other."""
    clock: ClockFault = ClockFault()
    facing_rad: float = 0.0
    """What the array faces, clockwise from the nose."""
    mirrored_share: float = 0.0
    """A linear array takes front for back: bearings mirrored about the array's line."""
    field_of_view_rad: float = math.tau
    """Centred on what the array faces."""
    range_m: float | None = None


@dataclass(frozen=True)
class SensorModel:
    """How good a simulated sensor is: noise per bearing, rate, delay, the share of reports that get lost, faults."""

    sigma_rad: float
    rate_hz: float = 10.0
    latency_s: float = 0.1
    drop_out: float = 0.0
    reference: Literal["true_north", "body"] = "true_north"
    faults: SensorFaults = field(default_factory=SensorFaults)
    resolution_rad: float = 0.0
    """The step that bearings are rounded to, noise and all; 0: to none."""


@dataclass
class SimulatedSensor:
    """One simulated sensor; `noise` is its random stream, and seeds those of its faults."""

    model: SensorModel
    noise: random.Random
    _sequence: int = field(default=0, init=False)
    _started_ns: int | None = field(default=None, init=False)
    _last: list[Bearing] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        seed, faults = self.noise.getstate()[1][:4], self.model.faults
        self._outliers, self._losses, self._mirrors, self._delays = (
            random.Random(f"{seed}/{name}")  # noqa: S311 - noise, not secrets
            for name in ("outliers", "losses", "mirrors", "delays")
        )
        self._gaps = _Occasions(faults.gaps, f"{seed}/gaps")
        self._stuck = _Occasions(faults.stuck, f"{seed}/stuck")

    def measure(
        self, captured_ns: int, own: complex, transmitters: Mapping[str, complex], heading_rad: float = 0.0
    ) -> BearingReport | None:
        """Return the report of one instant, or None when it is lost or nothing is heard.

        `captured_ns` is the true time; the report's is what the UAV's clock shows. Places are site positions,
        north + i east, m; the heading is the nose's azimuth, rad. Call it with rising times.
        """
        self._sequence += 1
        if not transmitters or self.noise.random() < self.model.drop_out:
            return None
        measured = [self._bearing(name, place - own, heading_rad) for name, place in transmitters.items()]
        bearings = [bearing for bearing in measured if bearing is not None]
        if self._gaps.at(captured_ns):
            return None
        if self._stuck.at(captured_ns) and self._last:
            bearings = self._last
        self._last = bearings
        if not bearings:
            return None
        return BearingReport(
            self.clock_ns(captured_ns),
            self._sequence,
            self.model.reference,
            bearings,
            resolution_rad=self.model.resolution_rad,
        )

    def clock_ns(self, true_ns: int) -> int:
        """Return what this UAV's clock shows at a true time; it runs from the first time that is asked for."""
        if self._started_ns is None:
            self._started_ns = true_ns
        return self.model.faults.clock.shown_ns(true_ns, self._started_ns)

    def delay_s(self) -> float:
        """Return how long after its capture the next report is to arrive, s."""
        return self.model.latency_s + self._delays.uniform(0.0, self.model.faults.latency_jitter_s)

    def _bearing(self, name: str, sight: complex, heading_rad: float) -> Bearing | None:
        faults = self.model.faults
        sigma_rad = faults.transmitter_sigma_rad.get(name, self.model.sigma_rad)
        azimuth_rad = direction(sight)
        error_rad = self.noise.gauss(0.0, sigma_rad) + faults.bias_rad + faults.transmitter_bias_rad.get(name, 0.0)
        if self._outliers.random() < faults.outlier_share:
            low_rad, high_rad = self._outliers.choice(faults.outlier_jumps_rad)
            error_rad += self._outliers.choice((-1, 1)) * self._outliers.uniform(low_rad, high_rad)
        if self._mirrors.random() < faults.mirrored_share:
            azimuth_rad = 2.0 * (heading_rad + faults.facing_rad) + math.pi - azimuth_rad
        if self.model.reference == "body":
            azimuth_rad -= heading_rad
        lost = self._losses.random() < faults.bearing_drop_out
        if lost or not self._in_sight(sight, heading_rad):
            return None
        shown_rad = azimuth_rad + error_rad
        if self.model.resolution_rad:
            shown_rad = round(shown_rad / self.model.resolution_rad) * self.model.resolution_rad
        return Bearing(name, shown_rad % math.tau, max(sigma_rad, LEAST_SIGMA_RAD))

    def _in_sight(self, sight: complex, heading_rad: float) -> bool:
        faults = self.model.faults
        if faults.range_m is not None and abs(sight) > faults.range_m:
            return False
        off_rad = wrap(direction(sight) - heading_rad - faults.facing_rad)
        return abs(off_rad) <= faults.field_of_view_rad / 2.0


class _Occasions:
    """When episodes take place: decided by time alone, however often it is asked."""

    def __init__(self, episodes: Episodes | None, seed: str) -> None:
        self._episodes = episodes
        self._draws = random.Random(seed)  # noqa: S311 - noise, not secrets
        self._begins_ns: int | None = None

    def at(self, time_ns: int) -> bool:
        """Return whether one is going on; times must not fall."""
        if self._episodes is None:
            return False
        for_ns = round(self._episodes.for_s * 1e9)
        if self._begins_ns is None:
            self._begins_ns = time_ns + self._pause_ns(self._episodes)
        while time_ns >= self._begins_ns + for_ns:
            self._begins_ns += for_ns + self._pause_ns(self._episodes)
        return time_ns >= self._begins_ns

    def _pause_ns(self, episodes: Episodes) -> int:
        return round(self._draws.expovariate(1.0 / episodes.every_s) * 1e9) + 1
