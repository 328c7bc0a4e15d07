"""The CSV that the KrakenSDR's direction-finding software writes when its data format is "Kraken App".

One line for each radio channel (VFO) above its squelch, of 377 fields:

1. time of the frame's end, ms since 1970-01-01 UTC       8. name of the station
2. direction of the strongest arrival, degrees            9., 10. latitude, longitude
3. confidence: the peak over the mean, dB                 11., 12. heading by GPS, by compass, degrees
4. power, dB below full scale                             13. which heading is the main one: GPS or Compass
5. frequency, Hz                                          14. to 17. reserved
6. antenna arrangement: UCA, ULA, Custom                  18. to 377. power at each of 360 degrees, dB
7. latency, ms: how long the frame took to acquire

The source is the KrakenSDR documentation, "Kraken App output format". It calls field 2 a compass direction; the
software writes 360 less the array's own direction, which is 0 at the array's front and counted counter-clockwise: so
field 2 is 1 to 360, clockwise, from the array's front. Other versions differ, which is why the adapter is told.
Without a place (latitude and longitude 0) the headings are 0 too, and mean nothing.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

FIELDS: Final = 377
_HEAD: Final = 17
_NUMBER: Final = re.compile(r"[+-]?[0-9]{1,20}(\.[0-9]{0,30})?([eE][+-]?[0-9]{1,3})?", re.ASCII)
_EARLIEST_MS: Final = 1_000_000_000_000
_LATEST_MS: Final = 99_999_999_999_999
_LONGEST_LATENCY_MS: Final = 60_000


class MalformedLineError(ValueError):
    """A line is not of the format; the message says which field and why."""


@dataclass(frozen=True)
class KrakenLine:
    """One line: what one channel heard in one frame. Angles in degrees as they stand there."""

    time_ms: int
    direction_deg: float
    confidence_db: float
    frequency_hz: float
    latency_ms: float
    gps_heading_deg: float | None
    compass_heading_deg: float | None
    main_heading: str
    measured: tuple[str, ...]
    """Confidence, power and the power at each degree, as written: no two frames of a working radio agree in them."""


def read_line(line: str) -> KrakenLine:
    """Return what a line says. MalformedLineError when it is not of the format."""
    fields = [field.strip() for field in line.split(",")]
    if len(fields) != FIELDS:
        raise MalformedLineError(f"has {len(fields)} fields, not {FIELDS}")
    for position, field in enumerate(fields[_HEAD:], start=_HEAD + 1):
        if _number(field) is None:
            raise MalformedLineError(f"field {position} is no number: {field!r:.40}")
    placed = any(_number(field) != 0.0 for field in fields[8:10])
    return KrakenLine(
        time_ms=round(_within(fields, 1, _EARLIEST_MS, _LATEST_MS)),
        direction_deg=_within(fields, 2, 0.0, 360.0),
        confidence_db=_within(fields, 3, 0.0, 1000.0),
        frequency_hz=_within(fields, 5, 1.0, 1e12),
        latency_ms=_within(fields, 7, 0.0, _LONGEST_LATENCY_MS),
        gps_heading_deg=_heading(fields[10]) if placed else None,
        compass_heading_deg=_heading(fields[11]) if placed else None,
        main_heading=fields[12],
        measured=(fields[2], fields[3], *fields[_HEAD:]),
    )


def _within(fields: list[str], position: int, least: float, most: float) -> float:
    text = fields[position - 1]
    value = _number(text)
    if value is None or not least <= value <= most:
        raise MalformedLineError(f"field {position} is no number from {least:g} to {most:g}: {text!r:.40}")
    return value


def _heading(text: str) -> float | None:
    value = _number(text)
    return value if value is not None and -360.0 <= value <= 360.0 else None


def _number(text: str) -> float | None:
    value = float(text) if _NUMBER.fullmatch(text) else math.nan
    return value if math.isfinite(value) else None
