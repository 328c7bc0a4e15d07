"""The time series of a run, series.jsonl: what each receiver in flight measured, where it was, who was on the air.

The screens' own values, written down: nothing in flight reads them. A line is a JSON object; `kind` says which one.
"""

from __future__ import annotations

import cmath
import logging
from dataclasses import dataclass, field
from typing import Final

import msgspec

from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import Emission, MalformedMessageError, decode
from drivers.bus.session import Bus
from drivers.clock import Clock
from drivers.strict_json import ESCAPES, malformed
from gcs.recording.lines import LineFile
from gcs.relay.records import LegRecord, ReceiverRecord
from gcs.relay.states import IN_FLIGHT
from gcs.safety import PositionBoard
from gcs.status import RunStatus
from gcs.stop_monitor import SLOT, TURN
from planner.frames import FormationFrame

log = logging.getLogger(__name__)

SAMPLE_S: Final = 0.2

Place = tuple[float, float]
"""x and y, formation frame, m."""


class Sample(msgspec.Struct, frozen=True, omit_defaults=True):
    """One receiver in flight at one moment; what was not known then is left out."""

    state: str
    at_m: Place | None = None
    nearest_m: float | None = None
    nearest: str | None = None
    angle_rad: float | None = None
    remaining_m: float | None = None
    cross_track_m: float | None = None
    sigma_m: float | None = None


class Tick(msgspec.Struct, frozen=True, tag="tick", tag_field="kind"):
    """Every receiver in flight at one moment."""

    time_ns: int
    receivers: dict[str, Sample]


class LegBegun(msgspec.Struct, frozen=True, tag="leg", tag_field="kind"):
    """A leg as it was planned from where the receiver was located; the band is what its stop may be off, m."""

    time_ns: int
    receiver: str
    number: int
    guide: str
    direction: str
    stop_reference: tuple[str, str]
    stop_angle_rad: float
    start_m: Place
    end_m: Place
    band_m: float


class LegEnded(msgspec.Struct, frozen=True, tag="stop", tag_field="kind"):
    """The stop condition of the receiver's leg held."""

    time_ns: int
    receiver: str
    number: int
    stop_angle_error_rad: float | None


class Switched(msgspec.Struct, frozen=True, tag="emission", tag_field="kind"):
    """A transmitter was told to emit, or to be silent."""

    time_ns: int
    transmitter: str
    on: bool


SeriesLine = Tick | LegBegun | LegEnded | Switched

_DECODER: Final = msgspec.json.Decoder(SeriesLine)


def read_line(line: bytes) -> SeriesLine:
    """Return what a line of series.jsonl holds; msgspec.MsgspecError when it holds nothing of the kind."""
    try:
        parsed: SeriesLine = _DECODER.decode(line)
    except ESCAPES as error:
        raise malformed(error) from None
    return parsed


@dataclass
class Series:
    """Writes the series of one run. Positions are those the vehicles tell."""

    lines: LineFile
    status: RunStatus
    board: PositionBoard
    frame: FormationFrame
    clock: Clock
    _known: dict[str, list[LegRecord]] = field(default_factory=dict)
    _flying: list[tuple[str, int, LegRecord]] = field(default_factory=list)

    def attach(self, bus: Bus, keys: SwarmKeys) -> None:
        """Note from now on who is switched on and off."""
        bus.subscribe(keys.every_emission, self._switched)

    async def record(self) -> None:
        """Sample until cancelled. Never raises: what is wrong with a recording must not end a flight."""
        try:
            while True:
                self.sample()
                await self.clock.sleep(SAMPLE_S)
        except Exception:
            log.exception("the series of the run cannot be recorded any more; the flight goes on")

    def sample(self) -> None:
        """Write one tick, and the legs begun and ended since the last one."""
        records = self.status.records.values()
        for record in records:
            self._note_legs(record)
        self._note_stops()
        flying = {record.name: self._sample(record) for record in records if record.state in IN_FLIGHT}
        if flying:
            self._write(Tick(self.clock.unix_ns(), flying))

    def _sample(self, record: ReceiverRecord) -> Sample:
        told, leg = self._told_place(record.name), record.leg
        nearest = self.board.smallest_separation_m(record.name)
        estimate = None if leg is None else leg.estimate
        return Sample(
            state=record.state.value,
            at_m=told,
            nearest_m=None if nearest is None else nearest[0],
            nearest=None if nearest is None else nearest[1],
            angle_rad=None if leg is None else leg.measured_angle_rad,
            remaining_m=None if estimate is None else estimate.remaining_m,
            cross_track_m=None if estimate is None else estimate.cross_track_m,
            sigma_m=None if estimate is None else estimate.remaining_sigma_m,
        )

    def _told_place(self, name: str) -> Place | None:
        told = self.board.latest.get(name)
        if told is None or not cmath.isfinite(told.north_east):
            return None
        return _place(self.frame.from_site(told.north_east))

    def _note_legs(self, record: ReceiverRecord) -> None:
        known = self._known.setdefault(record.name, [])
        for number, flown in enumerate(record.legs, start=1):
            if not any(flown is leg for leg in known):
                known.append(flown)
                self._flying.append((record.name, number, flown))
                self._begun(record, number, flown)

    def _note_stops(self) -> None:
        for flying in tuple(self._flying):
            name, number, flown = flying
            if flown.ended_s is not None:
                self._flying.remove(flying)
                self._write(LegEnded(self._ns(flown.ended_s), name, number, flown.stop_angle_error_rad))

    def _begun(self, record: ReceiverRecord, number: int, flown: LegRecord) -> None:
        leg, rule = flown.leg, SLOT if number == len(record.route.legs) else TURN
        self._write(
            LegBegun(
                time_ns=self._ns(flown.started_s),
                receiver=record.name,
                number=number,
                guide=leg.guide,
                direction=leg.direction,
                stop_reference=leg.stop_reference,
                stop_angle_rad=leg.stop_angle_rad,
                start_m=_place(leg.start),
                end_m=_place(leg.end),
                band_m=rule.band_m,
            )
        )

    def _switched(self, key: str, payload: bytes) -> None:
        transmitter = uav_of(key)
        if transmitter is None:
            return
        try:
            emission = decode(payload, Emission)
        except MalformedMessageError:
            return
        self._write(Switched(self.clock.unix_ns(), transmitter, emission.on))

    def _ns(self, time_s: float) -> int:
        """Return a time of the clock's monotonic scale as time since 1970, ns."""
        return self.clock.unix_ns() - round((self.clock.now_s() - time_s) * 1e9)

    def _write(self, line: SeriesLine) -> None:
        self.lines.append(msgspec.json.encode(line))


def _place(point: complex) -> Place:
    return point.real, point.imag
