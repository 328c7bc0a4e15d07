"""A leg flown at a node, as the service follows it: the stop monitor here is told all that the one there was told.

So both know the same of the receiver, to the bit but for the time at which the leg began; what is decided is decided
at the node.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from msgspec.structs import replace

from drivers.clock import Clock
from gcs.errors import HoldRequiredError
from gcs.nodes.messages import LegEnd, LegNotes, Refused
from gcs.nodes.retelling import retell
from gcs.relay.leg_flight import LegFlight, subtended
from gcs.relay.records import LegRecord
from gcs.traced_monitor import MonitorNote, TracedMonitor

NEWS_S: Final = 2.0
"""A leg that nothing is told of for so long is held: a node tells ten times a second."""
LOOK_S: Final = 0.1
_LATER_S: Final = 2.0
"""A node ends a leg by itself that takes too long; so much later it is not waited for any more."""


class Told:
    """What is told of one order, as it comes."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: deque[LegNotes | Refused] = deque()
        self._arrival = asyncio.Event()

    def push(self, report: LegNotes | Refused) -> None:
        """Add one."""
        self._waiting.append(report)
        self._arrival.set()

    async def next(self, timeout_s: float) -> LegNotes | Refused | None:
        """Return the next one, or None when none came within `timeout_s`."""
        if not self._waiting:
            self._arrival.clear()
            waiting = asyncio.ensure_future(self._arrival.wait())
            timer = asyncio.ensure_future(self._clock.sleep(timeout_s))
            try:
                await asyncio.wait((waiting, timer), return_when=asyncio.FIRST_COMPLETED)
            finally:
                waiting.cancel()
                timer.cancel()
        return self._waiting.popleft() if self._waiting else None


@dataclass
class RemoteLeg:
    """One leg under way at `node`. `lost` says why the node is gone, or None; `object_` tells it an objection."""

    flight: LegFlight
    monitor: TracedMonitor
    node: str
    told: Told
    lost: Callable[[], str | None]
    object_: Callable[[str], None]
    _told: int = field(default=0, init=False)
    _heard_s: float = field(default=0.0, init=False)
    """When the notes came that were due."""
    _early: dict[int, LegNotes] = field(default_factory=dict, init=False)
    """What has overtaken others, by its first note."""

    async def follow(self) -> None:
        """Follow it until it has ended at its stop condition. HoldRequiredError when the receiver must hold."""
        flight, clock = self.flight, self.flight.clock
        flown = LegRecord(self.monitor.leg, started_s=clock.now_s())
        flight.record.legs.append(flown)
        latest_s = flown.started_s + flight.settings.longest_leg_s(flown.leg) + _LATER_S
        self._heard_s = looked_s = flown.started_s
        while True:
            report = await self.told.next(LOOK_S)
            now_s = clock.now_s()
            if report is not None:
                ended = self._take(report, flown)
                if ended is not None:
                    self._end(ended, flown, now_s)
                    return
            if now_s - looked_s >= LOOK_S:
                looked_s = now_s
                self.object_(flight.objection() or "")
            self._require_news(now_s - self._heard_s)
            if now_s > latest_s:
                raise HoldRequiredError(f"the leg took longer than {flight.settings.longest_leg_s(flown.leg):.0f} s")

    def _require_news(self, silent_s: float) -> None:
        if (lost := self.lost()) is not None:
            raise HoldRequiredError(f"its node {self.node} is lost: {lost}")
        if silent_s > NEWS_S:
            gaps = "leaves gaps in what it tells" if self._early else "tells nothing"
            raise HoldRequiredError(f"its node {self.node} {gaps} of the leg for {silent_s:.1f} s")

    def _take(self, report: LegNotes | Refused, flown: LegRecord) -> LegEnd | None:
        """Take in what is told; return how the leg has ended, when it has."""
        if isinstance(report, Refused):
            raise HoldRequiredError(f"its node {self.node} does not fly it: {report.why}")
        self._early[report.first] = report
        ended = None
        while (due := self._early.pop(self._told, None)) is not None:
            ended = self._take_in_turn(due, flown)
        return ended

    def _take_in_turn(self, report: LegNotes, flown: LegRecord) -> LegEnd | None:
        self._told += len(report.notes)
        self._heard_s = self.flight.clock.now_s()
        for note in report.notes:
            self._retell(replace(note, time_s=note.time_s + self.monitor.time_s), flown)
        flown.outliers = self.monitor.outliers
        if report.reason != self.flight.record.reason:
            self.flight.record.reason = report.reason
            self.flight.announce(self.flight.record)
        return report.ended

    def _retell(self, note: MonitorNote, flown: LegRecord) -> None:
        answered = retell(self.monitor, note)
        if answered is not None:
            flown.estimate = self.monitor.estimate(answered[0])
        if note.observed is not None:
            measured_rad = subtended(flown.leg, note.observed.directions_rad)
            flown.measured_angle_rad = flown.measured_angle_rad if measured_rad is None else measured_rad

    def _end(self, ended: LegEnd, flown: LegRecord, now_s: float) -> None:
        if not ended.arrived:
            raise HoldRequiredError(ended.reason)
        flown.ended_s = now_s
        flown.stop_angle_error_rad = ended.stop_angle_error_rad
