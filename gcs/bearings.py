"""Bearing reports off the bus: validated, counted, and handed to whoever flies that receiver."""

from __future__ import annotations

import asyncio
import contextlib
import operator
from collections import deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Final, Literal

from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import BearingReport, MalformedMessageError, decode
from drivers.bus.session import Bus
from drivers.clock import Clock
from gcs.clock_offsets import CaptureTime, ClockOffsets
from gcs.report_checks import TIMING, BearingCounters, ReportChecks
from planner.angles import wrap
from planner.frames import FormationFrame

Reference = Literal["true_north", "body"]


@dataclass(frozen=True)
class Observation:
    """The directions one receiver measured at one instant: polar, formation frame, rad, by transmitter.

    With the reference "body" they are polar from the nose of the UAV instead: only their differences mean anything.
    """

    captured_s: float
    directions_rad: dict[str, float]
    sigma_rad: dict[str, float]
    reference: Reference = "true_north"
    captured_uncertainty_s: float = 0.0
    """What is known of the sensor's clock and of the capture; 0 where the sensor says neither."""


class Observations:
    """The observations of one receiver as they come; a slow reader loses the oldest."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: deque[Observation] = deque(maxlen=64)
        self._arrival: asyncio.Future[None] | None = None

    def push(self, observation: Observation) -> None:
        """Add one."""
        self._waiting.append(observation)
        if self._arrival is not None and not self._arrival.done():
            self._arrival.set_result(None)

    def forget(self) -> None:
        """Drop what waits: only what is captured from now on counts."""
        self._waiting.clear()

    async def next(self, timeout_s: float) -> Observation | None:
        """Return the next observation, or None when none came within `timeout_s`."""
        if not self._waiting:
            self._arrival = asyncio.get_running_loop().create_future()
            timer = asyncio.ensure_future(self._clock.sleep(timeout_s))
            try:
                await asyncio.wait((self._arrival, timer), return_when=asyncio.FIRST_COMPLETED)
            finally:
                timer.cancel()
        return self._waiting.popleft() if self._waiting else None


class BearingFeed:
    """Takes every bearing report of the swarm; those that are no good are counted by what is wrong, and dropped.

    Capture times are converted with what `clocks` knows of the sensors' clocks. Bearings that refer to the UAV's body
    are taken only when `reference` says that the flight expects them.
    """

    def __init__(
        self,
        receivers: Collection[str],
        frame: FormationFrame,
        clock: Clock,
        max_age_s: float,
        clocks: ClockOffsets | None = None,
        reference: Reference = "true_north",
    ) -> None:
        self.latest: dict[str, Observation] = {}
        self._checks = {name: ReportChecks(max_age_s) for name in receivers}
        self._readers: dict[str, list[Observations]] = {name: [] for name in receivers}
        self._strangers = 0
        self._frame = frame
        self._clock = clock
        self._clocks = clocks or ClockOffsets(receivers, clock)
        self.reference: Final = reference

    @property
    def counters(self) -> BearingCounters:
        """What became of all reports."""
        total = BearingCounters(received=self._strangers, unknown_sender=self._strangers)
        for checks in self._checks.values():
            total.add(checks.counters)
        return total

    @property
    def by_receiver(self) -> dict[str, BearingCounters]:
        """What became of each receiver's reports."""
        return {name: checks.counters for name, checks in self._checks.items()}

    def attach(self, bus: Bus, keys: SwarmKeys) -> None:
        """Take the reports of a swarm off the bus."""
        bus.subscribe(keys.every_bearings, self.take)

    @contextlib.contextmanager
    def listen(self, receiver: str) -> Iterator[Observations]:
        """Hand the observations of one receiver to the block, from now on."""
        observations = Observations(self._clock)
        self._readers[receiver].append(observations)
        try:
            yield observations
        finally:
            self._readers[receiver].remove(observations)

    def take(self, key: str, payload: bytes) -> None:
        """Take one report as it comes off the bus."""
        receiver = uav_of(key)
        if receiver is None or receiver not in self._checks:
            self._strangers += 1
            return
        checks = self._checks[receiver]
        checks.counters.received += 1
        try:
            report = decode(payload, BearingReport)
        except MalformedMessageError:
            checks.counters.malformed += 1
            return
        if report.reference == "body" and self.reference != "body":
            checks.counters.without_heading += 1  # such bearings cannot guide a leg
            return
        captured = self._clocks.captured(receiver, report)
        problem = checks.problem(report, captured)
        if problem is None:
            self._hand_out(receiver, report, captured)
            return
        checks.counters.count(problem)
        if problem in TIMING:
            self._clocks.ask_again(receiver)

    def _hand_out(self, receiver: str, report: BearingReport, captured: CaptureTime) -> None:
        directed = self._frame.azimuth_rad if report.reference == "true_north" else operator.neg
        observation = Observation(
            captured_s=self._clock.now_s() - max(captured.age_s, 0.0),
            directions_rad={b.transmitter: wrap(directed(b.azimuth_rad)) for b in report.bearings},
            sigma_rad={b.transmitter: b.sigma_rad for b in report.bearings},
            reference=report.reference,
            captured_uncertainty_s=(captured.clock_uncertainty_s or 0.0) + report.captured_uncertainty_ns * 1e-9,
        )
        self.latest[receiver] = observation
        for reader in self._readers[receiver]:
            reader.push(observation)


async def collect(observations: Observations, count: int, needed: Collection[str], gap_s: float) -> list[Observation]:
    """Return the next `count` observations that hold every needed transmitter; fewer when bearings are missing.

    Gives up when no report comes for `gap_s`, or when most reports lack a transmitter.
    """
    collected: list[Observation] = []
    for _ in range(4 * count):
        observation = await observations.next(gap_s)
        if observation is None:
            break
        if all(name in observation.directions_rad for name in needed):
            collected.append(observation)
        if len(collected) == count:
            break
    return collected
