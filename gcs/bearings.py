"""Bearing reports off the bus: validated, counted, and handed to whoever flies that receiver."""

from __future__ import annotations

import asyncio
import contextlib
import math
import operator
from collections import deque
from collections.abc import Callable, Collection, Iterator
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
    resolution_rad: float = 0.0
    """The step that directions were rounded to, which is beside `sigma_rad`; 0: to none."""


class Observations:
    """The observations of one receiver as they come; a slow reader loses the oldest.

    None is handed on that is older than `max_age_s` by then, however it was held up; each one lost so is `too_old`.
    """

    def __init__(self, clock: Clock, max_age_s: float = math.inf, too_old: Callable[[], None] = lambda: None) -> None:
        self._clock = clock
        self._max_age_s = max_age_s
        self._too_old = too_old
        self._waiting: deque[Observation] = deque(maxlen=64)
        self._arrival: asyncio.Future[bool] | None = None

    def push(self, observation: Observation) -> None:
        """Add one."""
        self._waiting.append(observation)
        if self._arrival is not None and not self._arrival.done():
            self._arrival.set_result(True)

    def forget(self) -> None:
        """Drop what waits: only what is captured from now on counts."""
        self._waiting.clear()

    async def next(self, timeout_s: float) -> Observation | None:
        """Return the next observation, or None when none came within `timeout_s`."""
        until_s = self._clock.now_s() + timeout_s
        while not self._something_new():
            left_s = until_s - self._clock.now_s()
            if left_s <= 0.0 or not (await self._arrives(left_s) or self._something_new()):
                return None
        return self._waiting.popleft()

    def _something_new(self) -> bool:
        """Return whether an observation waits, once those that have become too old are dropped."""
        oldest_s = self._clock.now_s() - self._max_age_s
        while self._waiting and self._waiting[0].captured_s < oldest_s:
            self._waiting.popleft()
            self._too_old()
        return bool(self._waiting)

    async def _arrives(self, within_s: float) -> bool:
        arrival: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._arrival = arrival
        timer = asyncio.ensure_future(self._clock.sleep(within_s))
        timer.add_done_callback(lambda _: None if arrival.done() else arrival.set_result(False))
        try:
            return await arrival
        finally:
            timer.cancel()


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
        self._max_age_s = max_age_s
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
        counters = self._checks[receiver].counters
        observations = Observations(self._clock, self._max_age_s, lambda: counters.count("stale"))
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
            resolution_rad=report.resolution_rad,
        )
        self.latest[receiver] = observation
        for reader in self._readers[receiver]:
            reader.push(observation)
