"""The KrakenSDR as an AOA sensor: polls what its direction-finding software serves, and makes bearings of it.

Run it on the computer that runs the KrakenSDR's software: capture times are that computer's.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, Final, Literal

import msgspec

from drivers.aoa.http_text import HttpAddress, fetch_text
from drivers.aoa.kraken_csv import KrakenLine, MalformedLineError, read_line
from drivers.aoa.sensor import Publish, Say
from drivers.bus.messages import Bearing, BearingReport, Name
from drivers.clock import Clock
from drivers.errors import SensorError

LARGEST_BYTES: Final = 1_000_000
FROZEN_AFTER: Final = 3
"""So many frames in a row with the same measurements to the last digit are no measurements."""

_ONE_DEGREE_RAD: Final = math.radians(1.0)
_FIRST_PAUSE_S: Final = 0.5
_LONGEST_PAUSE_S: Final = 5.0
_AHEAD_MS: Final = 500
_TORN_LINES: Final = 10
"""So many malformed lines may happen: read while they are written."""

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
Degrees = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]


class SigmaFrom(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """From a confidence on, how good a bearing is."""

    confidence_db: Annotated[float, msgspec.Meta(ge=0.0)]
    sigma_deg: Annotated[float, msgspec.Meta(gt=0.0, le=90.0)]


class KrakenSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How one KrakenSDR is mounted and what its numbers mean. Nothing of that can be seen from the numbers.

    The azimuth from the nose is `zero_deg` plus the direction read, counted as `direction` says.
    """

    transmitters_mhz: Annotated[dict[Name, Positive], msgspec.Meta(min_length=1)]
    """Who transmits on what frequency; each needs a channel (VFO) of its own."""
    direction: Literal["clockwise", "counter_clockwise"]
    """How the direction read is counted: like a compass, or like the unit circle."""
    zero_deg: Degrees
    """Where a direction of 0 points, clockwise from the nose of the UAV."""
    heading: Literal["none", "gps", "compass", "main", "fixed"]
    """What heading makes true bearings of them; none: they stay relative to the nose.

    A course over ground, as from a GPS without a second antenna, is no heading in hover.
    """
    fixed_heading_deg: Degrees = 0.0
    declination_deg: Degrees = 0.0
    """Added to a heading by compass: magnetic north is this far east of true north."""
    sigma: Annotated[tuple[SigmaFrom, ...], msgspec.Meta(min_length=1)] = (
        SigmaFrom(2.0, 12.0),
        SigmaFrom(5.0, 6.0),
        SigmaFrom(10.0, 3.0),
    )
    """The last row that the confidence reaches says how good a bearing is; below the first it is dropped.

    The default is cautious: measure your own array against a transmitter at a known place. That bearings are rounded
    to whole degrees is no part of it: reports say so.
    """
    tolerance_khz: Positive = 12.5
    url: str = "http://127.0.0.1:8081/DOA_value.html"
    poll_s: Annotated[float, msgspec.Meta(ge=0.01, le=10.0)] = 0.1
    timeout_s: Annotated[float, msgspec.Meta(ge=0.05, le=60.0)] = 1.0
    max_age_s: Positive = 2.0

    def __post_init__(self) -> None:
        HttpAddress.parse(self.url)
        steps = [row.confidence_db for row in self.sigma]
        if steps != sorted(set(steps)):
            raise ValueError("sigma: the rows must have rising confidence_db")
        channels = sorted(self.transmitters_mhz.values())
        if any(high - low <= 2e-3 * self.tolerance_khz for low, high in pairwise(channels)):
            raise ValueError("transmitters_mhz: two are within each other's tolerance_khz")

    def open(self, clock: Clock) -> KrakenSensor:
        """Return the sensor."""
        return KrakenSensor(self, clock)


@dataclass
class KrakenReader:
    """Makes reports of the text that the KrakenSDR serves; what cannot be used is counted by what is wrong."""

    settings: KrakenSettings
    counts: Counter[str] = field(default_factory=Counter)
    _seen_ms: frozenset[int] = frozenset()
    _sequence: int = 0
    _measured: dict[str, tuple[str, ...]] = field(default_factory=dict)
    _repeats: Counter[str] = field(default_factory=Counter)

    def reports(self, text: str, now_ms: int) -> list[BearingReport]:
        """Return the reports of the frames in a text, oldest first; a frame seen before gives none."""
        frames: dict[int, list[KrakenLine]] = {}
        shown_ms: set[int] = set()
        for line in filter(str.strip, text.splitlines()):
            try:
                read = read_line(line)
            except MalformedLineError:
                self.counts["malformed"] += 1
                continue
            shown_ms.add(read.time_ms)
            if read.time_ms not in self._seen_ms:
                frames.setdefault(read.time_ms, []).append(read)
        if shown_ms:
            self._seen_ms = frozenset(shown_ms)
        made = (self._report(time_ms, frames[time_ms], now_ms) for time_ms in sorted(frames))
        return [report for report in made if report is not None]

    def _report(self, time_ms: int, lines: list[KrakenLine], now_ms: int) -> BearingReport | None:
        if now_ms - time_ms > self.settings.max_age_s * 1e3:
            self.counts["stale"] += len(lines)
            return None
        if time_ms > now_ms + _AHEAD_MS:
            self.counts["from_the_future"] += len(lines)
            return None
        bearings = self._bearings(lines)
        if not bearings:
            return None
        self._sequence += 1
        half_ns = round(max(line.latency_ms for line in lines) / 2.0 * 1e6)
        return BearingReport(
            captured_ns=time_ms * 1_000_000 - half_ns,  # the middle of the frame
            sequence=self._sequence,
            reference="body" if self.settings.heading == "none" else "true_north",
            bearings=list(bearings.values()),
            captured_uncertainty_ns=half_ns,
            resolution_rad=_ONE_DEGREE_RAD if all(line.direction_deg.is_integer() for line in lines) else 0.0,
        )

    def _bearings(self, lines: Iterable[KrakenLine]) -> dict[str, Bearing]:
        """Return the usable bearings of one frame by transmitter; of two channels on one, the more confident."""
        bearings: dict[str, Bearing] = {}
        channels: Counter[str] = Counter()
        for line in sorted(lines, key=lambda line: line.confidence_db):
            name = self._transmitter(line.frequency_hz)
            channels[name or ""] += 1
            if name is None:
                self.counts["unknown_frequency"] += 1
            elif self._frozen(f"{name}/{channels[name]}", line):
                self.counts["frozen"] += 1
            elif (sigma_rad := self._sigma_rad(line.confidence_db)) is None:
                self.counts["weak"] += 1
            elif (heading_deg := self._heading_deg(line)) is None:
                self.counts["without_heading"] += 1
            else:
                counted = 1.0 if self.settings.direction == "clockwise" else -1.0
                azimuth_deg = heading_deg + self.settings.zero_deg + counted * line.direction_deg
                bearings[name] = Bearing(name, math.radians(azimuth_deg % 360.0), sigma_rad)
        return bearings

    def _transmitter(self, frequency_hz: float) -> str | None:
        for name, mhz in self.settings.transmitters_mhz.items():
            if abs(frequency_hz - mhz * 1e6) <= self.settings.tolerance_khz * 1e3:
                return name
        return None

    def _frozen(self, channel: str, line: KrakenLine) -> bool:
        self._repeats[channel] = self._repeats[channel] + 1 if self._measured.get(channel) == line.measured else 0
        self._measured[channel] = line.measured
        return self._repeats[channel] >= FROZEN_AFTER - 1

    def _sigma_rad(self, confidence_db: float) -> float | None:
        reached = [row.sigma_deg for row in self.settings.sigma if confidence_db >= row.confidence_db]
        return math.radians(reached[-1]) if reached else None

    def _heading_deg(self, line: KrakenLine) -> float | None:
        """Return the azimuth of the nose, or 0 for bearings relative to it, or None when the line does not say."""
        source = self.settings.heading
        if source == "main":
            source = "compass" if line.main_heading.lower() == "compass" else "gps"
        if source == "compass":
            magnetic_deg = line.compass_heading_deg
            return None if magnetic_deg is None else magnetic_deg + self.settings.declination_deg
        if source == "gps":
            return line.gps_heading_deg
        return self.settings.fixed_heading_deg if source == "fixed" else 0.0


class KrakenSensor:
    """Polls one KrakenSDR; one that does not answer is asked less and less often. Every trouble is said once."""

    def __init__(self, settings: KrakenSettings, clock: Clock) -> None:
        self._settings = settings
        self._address = HttpAddress.parse(settings.url)
        self._clock = clock
        self._reader = KrakenReader(settings)
        self._said: set[str] = set()

    @property
    def counts(self) -> Mapping[str, int]:
        """What became of what it read: lines by what is wrong with them, and polls without an answer."""
        return self._reader.counts

    async def run(self, publish: Publish, say: Say) -> None:
        """Poll until cancelled."""
        pause_s = _FIRST_PAUSE_S
        while True:
            try:
                text = await fetch_text(self._address, self._settings.timeout_s, LARGEST_BYTES)
            except SensorError as error:
                self._reader.counts["no_answer"] += 1
                self._say_once(say, "no_answer", f"{error}; trying again")
                await self._clock.sleep(pause_s)
                pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)
                continue
            pause_s = _FIRST_PAUSE_S
            if "no_answer" in self._said:
                self._said.remove("no_answer")
                say(f"{self._address} answers again")
            for report in self._reader.reports(text, self._clock.unix_ns() // 1_000_000):
                publish(report)
            for problem, sentence in _SENTENCES.items():
                if self.counts[problem] > (_TORN_LINES if problem == "malformed" else 0):
                    self._say_once(say, problem, sentence)
            await self._clock.sleep(self._settings.poll_s)

    def _say_once(self, say: Say, problem: str, sentence: str) -> None:
        if problem not in self._said:
            self._said.add(problem)
            say(sentence)


_SENTENCES: Final = {
    "stale": "the KrakenSDR's frames are old: is direction finding switched on there, and its clock set?",
    "from_the_future": "the KrakenSDR's frames come from the future: its clock is ahead of this computer's",
    "malformed": "the KrakenSDR serves lines that are not of the format 'Kraken App': choose that data format there",
    "frozen": "the KrakenSDR repeats one measurement under new times: restart its software",
    "unknown_frequency": "the KrakenSDR has a channel on a frequency that no transmitter has: see transmitters_mhz",
    "without_heading": "the KrakenSDR has no heading of the kind that the settings name",
}
