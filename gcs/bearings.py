"""Bearing reports off the bus: validated, counted, and handed to whoever flies that receiver."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import BearingReport, MalformedMessageError, decode
from drivers.bus.session import Bus
from drivers.clock import Clock
from planner.angles import wrap
from planner.frames import FormationFrame


@dataclass
class BearingCounters:
    """What became of the bearing reports."""

    received: int = 0
    stale: int = 0
    out_of_order: int = 0
    malformed: int = 0
    unknown_sender: int = 0


@dataclass(frozen=True)
class Observation:
    """The directions one receiver measured at one instant: polar, formation frame, rad, by transmitter."""

    captured_s: float
    directions_rad: dict[str, float]
    sigma_rad: dict[str, float]


class Observations:
    """The observations of one receiver as they come; a slow reader loses the oldest."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: deque[Observation] = deque(maxlen=64)
        self._arrived = asyncio.Event()

    def push(self, observation: Observation) -> None:
        """Add one."""
        self._waiting.append(observation)
        self._arrived.set()

    def forget(self) -> None:
        """Drop what waits: only what is captured from now on counts."""
        self._waiting.clear()

    async def next(self, timeout_s: float) -> Observation | None:
        """Return the next observation, or None when none came within `timeout_s`."""
        if not self._waiting:
            self._arrived.clear()
            arrival = asyncio.ensure_future(self._arrived.wait())
            timer = asyncio.ensure_future(self._clock.sleep(timeout_s))
            try:
                await asyncio.wait((arrival, timer), return_when=asyncio.FIRST_COMPLETED)
            finally:
                arrival.cancel()
                timer.cancel()
        return self._waiting.popleft() if self._waiting else None


class BearingFeed:
    """Takes every bearing report of the swarm; malformed, stale, repeated and unknown ones are counted and dropped."""

    def __init__(self, receivers: Collection[str], frame: FormationFrame, clock: Clock, max_age_s: float) -> None:
        self.counters = BearingCounters()
        self.latest: dict[str, Observation] = {}
        self._receivers = frozenset(receivers)
        self._frame = frame
        self._clock = clock
        self._max_age_s = max_age_s
        self._last_captured_ns: dict[str, int] = {}
        self._readers: dict[str, list[Observations]] = {}

    def attach(self, bus: Bus, keys: SwarmKeys) -> None:
        """Take the reports of a swarm off the bus."""
        bus.subscribe(keys.every_bearings, self.take)

    @contextlib.contextmanager
    def listen(self, receiver: str) -> Iterator[Observations]:
        """Hand the observations of one receiver to the block, from now on."""
        observations = Observations(self._clock)
        self._readers.setdefault(receiver, []).append(observations)
        try:
            yield observations
        finally:
            self._readers[receiver].remove(observations)

    def take(self, key: str, payload: bytes) -> None:
        """Take one report as it comes off the bus."""
        self.counters.received += 1
        receiver = uav_of(key)
        if receiver is None or receiver not in self._receivers:
            self.counters.unknown_sender += 1
            return
        try:
            report = decode(payload, BearingReport)
        except MalformedMessageError:
            self.counters.malformed += 1
            return
        if report.reference != "true_north":
            self.counters.malformed += 1  # bearings without a heading cannot guide a leg
            return
        age_s = (self._clock.unix_ns() - report.captured_ns) * 1e-9
        if not -self._max_age_s <= age_s <= self._max_age_s:
            self.counters.stale += 1
            return
        if report.captured_ns <= self._last_captured_ns.get(receiver, -1):
            self.counters.out_of_order += 1
            return
        self._last_captured_ns[receiver] = report.captured_ns
        self._hand_out(receiver, report, max(age_s, 0.0))

    def _hand_out(self, receiver: str, report: BearingReport, age_s: float) -> None:
        observation = Observation(
            captured_s=self._clock.now_s() - age_s,
            directions_rad={b.transmitter: wrap(self._frame.azimuth_rad(b.azimuth_rad)) for b in report.bearings},
            sigma_rad={b.transmitter: b.sigma_rad for b in report.bearings},
        )
        self.latest[receiver] = observation
        for reader in self._readers.get(receiver, ()):
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
