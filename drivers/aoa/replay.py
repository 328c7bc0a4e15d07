"""A recorded sensor: replays bearing reports from a file as if they were measured now."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import msgspec

from drivers.aoa.sensor import Publish, Say
from drivers.bus.messages import BearingReport, MalformedMessageError, decode
from drivers.clock import Clock
from drivers.errors import SensorError

_BETWEEN_S: Final = 0.1


class ReplaySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is replayed: a file of BearingReports, each a line of JSON, in the order of their capture."""

    path: str
    repeat: bool = False

    def open(self, clock: Clock) -> Replay:
        """Return the sensor."""
        return Replay(self, clock)


class Replay:
    """Publishes the reports at the pace they were captured at, captured anew."""

    def __init__(self, settings: ReplaySettings, clock: Clock) -> None:
        self._settings = settings
        self._clock = clock
        self._counts: Counter[str] = Counter()
        self._sequence = 0

    @property
    def counts(self) -> Mapping[str, int]:
        """How many lines were no reports, or out of order."""
        return self._counts

    async def run(self, publish: Publish, say: Say) -> None:
        """Replay once, or again and again. SensorError when the file cannot be read or holds no report."""
        count = await self._once(publish)
        while self._settings.repeat:
            await self._clock.sleep(_BETWEEN_S)
            await self._once(publish)
        say(f"{self._settings.path}: replayed {count} reports")

    async def _once(self, publish: Publish) -> int:
        started_s, first_ns, last_ns, count = self._clock.now_s(), None, -1, 0
        for report in self._reports():
            if report.captured_ns <= last_ns:
                self._counts["out_of_order"] += 1
                continue
            first_ns, last_ns = report.captured_ns if first_ns is None else first_ns, report.captured_ns
            await self._clock.sleep(started_s + (last_ns - first_ns) * 1e-9 - self._clock.now_s())
            count += 1
            self._sequence += 1
            publish(
                msgspec.structs.replace(report, captured_ns=self._clock.unix_ns(), sequence=self._sequence, clock="")
            )
        if not count:
            raise SensorError(f"{self._settings.path} holds no bearing report: it takes one line of JSON for each")
        return count

    def _reports(self) -> Iterator[BearingReport]:
        try:
            with Path(self._settings.path).open("rb") as file:
                for line in filter(bytes.strip, file):
                    try:
                        yield decode(line, BearingReport)
                    except MalformedMessageError:
                        self._counts["malformed"] += 1
        except OSError as error:
            raise SensorError(f"{self._settings.path} cannot be replayed: {error}") from error
