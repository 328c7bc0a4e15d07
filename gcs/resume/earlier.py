"""What an earlier service flew of a run, from its time series: without it a report would tell of the rest alone."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec

from gcs.recording.series import LegBegun, LegEnded, Sample, SeriesLine, Switched, read_line

FILE: Final = "series.jsonl"
_ON_LEGS: Final = frozenset({"LEG_1", "LEG_2", "TRIMMING"})


@dataclass
class FlownLeg:
    """One leg of a receiver, as far as it was flown."""

    began_ns: int
    length_m: float = 0.0
    ended_ns: int | None = None
    stop_angle_error_rad: float | None = None


@dataclass
class Earlier:
    """What was flown before: the legs of each receiver since it was last located, and figures of all of it."""

    legs: defaultdict[str, dict[int, FlownLeg]] = field(default_factory=lambda: defaultdict(dict))
    flown_m: float = 0.0
    min_separation_m: float | None = None
    emission_transmitter_s: float = 0.0


def read_earlier(folder: Path, now_ns: int) -> Earlier:
    """Return what the series in a run's folder tells; lines that cannot be read are left out.

    Who was on the air when the service ended has been until now: nobody was there to switch it off.
    """
    path = folder / FILE
    return earlier_of(path.read_bytes().splitlines() if path.exists() else [], now_ns)


def earlier_of(lines: Iterable[bytes], now_ns: int) -> Earlier:
    """Return what the lines of a series tell."""
    earlier = Earlier()
    on_since_ns: dict[str, int] = {}
    last_at: dict[str, tuple[float, float]] = {}
    for line in _readable(lines):
        if isinstance(line, LegBegun):
            _begin(earlier, line)
        elif isinstance(line, LegEnded):
            if (leg := earlier.legs[line.receiver].get(line.number)) is not None:
                leg.ended_ns, leg.stop_angle_error_rad = line.time_ns, line.stop_angle_error_rad
        elif isinstance(line, Switched):
            since_ns = on_since_ns.pop(line.transmitter, line.time_ns)
            earlier.emission_transmitter_s += (line.time_ns - since_ns) * 1e-9
            if line.on:
                on_since_ns[line.transmitter] = line.time_ns
        else:
            for name, sample in line.receivers.items():
                _take(earlier, name, sample, last_at)
    earlier.emission_transmitter_s += sum(now_ns - since_ns for since_ns in on_since_ns.values()) * 1e-9
    return earlier


def with_earlier(report: Mapping[str, Any], earlier: Earlier) -> dict[str, Any]:
    """Return a report.json object of what was flown since, with what was flown before."""
    separations_m = [each for each in (report["min_separation_m"], earlier.min_separation_m) if each is not None]
    return {
        **report,
        "flown_total_length_m": report["flown_total_length_m"] + earlier.flown_m,
        "min_separation_m": min(separations_m, default=None),
        "emission_transmitter_s": report["emission_transmitter_s"] + earlier.emission_transmitter_s,
        "receivers": [_receiver(receiver, earlier.legs.get(receiver["name"], {})) for receiver in report["receivers"]],
    }


def _readable(lines: Iterable[bytes]) -> Iterable[SeriesLine]:
    for line in lines:
        try:
            yield read_line(line)
        except msgspec.MsgspecError:
            continue


def _begin(earlier: Earlier, line: LegBegun) -> None:
    legs = earlier.legs[line.receiver]
    if line.number == 1:
        legs.clear()
    legs[line.number] = FlownLeg(line.time_ns)


def _take(earlier: Earlier, name: str, sample: Sample, last_at: dict[str, tuple[float, float]]) -> None:
    if sample.nearest_m is not None:
        least_m = earlier.min_separation_m
        earlier.min_separation_m = sample.nearest_m if least_m is None else min(least_m, sample.nearest_m)
    if sample.at_m is None:
        return
    before = last_at.get(name, sample.at_m)
    last_at[name] = sample.at_m
    if sample.state in _ON_LEGS and earlier.legs[name]:
        step_m = math.dist(before, sample.at_m)
        earlier.flown_m += step_m
        earlier.legs[name][max(earlier.legs[name])].length_m += step_m


def _receiver(receiver: Mapping[str, Any], legs: Mapping[int, FlownLeg]) -> dict[str, Any]:
    """Return a receiver that was not flown since with the legs it was flown before."""
    if any(leg["flown_length_m"] is not None for leg in receiver["legs"]):
        return dict(receiver)
    told = [leg | _figures(legs.get(number)) for number, leg in enumerate(receiver["legs"], start=1)]
    return {**receiver, "legs": told}


def _figures(leg: FlownLeg | None) -> dict[str, Any]:
    if leg is None:
        return {}
    error_rad, ended_ns = leg.stop_angle_error_rad, leg.ended_ns
    return {
        "flown_length_m": leg.length_m,
        "stop_angle_error_deg": None if error_rad is None else math.degrees(error_rad),
        "duration_s": None if ended_ns is None else (ended_ns - leg.began_ns) * 1e-9,
    }
