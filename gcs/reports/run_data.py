"""A run as its folder tells it: everything the report shows, read back, with what is missing said."""

from __future__ import annotations

import contextlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from drivers import strict_json
from drivers.strict_json import MalformedError
from gcs.errors import ServiceError
from gcs.recording.facts import FILE as FACTS_FILE
from gcs.recording.facts import RunFacts
from gcs.recording.series import LegBegun, LegEnded, Sample, SeriesLine, Switched, Tick, read_line
from gcs.reports.run_files import PlaybookPart, Result, TrafficFigures, read_json, read_lines, read_text
from planner.plan import RelayPlan, plan_from_json

_LATEST_NS: Final = 2**63


@dataclass(frozen=True)
class Event:
    """A line of the journal, s since the run began."""

    time_s: float
    receiver: str
    state: str
    text: str


@dataclass
class FlownLeg:
    """A leg as it was flown: its samples are (s since the run began, sample)."""

    begun: LegBegun
    start_s: float
    end_s: float | None = None
    stop_angle_error_rad: float | None = None
    samples: list[tuple[float, Sample]] = field(default_factory=list)


@dataclass(frozen=True)
class RunData:
    """One run. Times are s since it began; `emission` is who was on the air, from when until when."""

    folder: Path
    playbook: PlaybookPart
    playbook_text: str
    plan: RelayPlan
    facts: RunFacts | None
    result: Result | None
    traffic: TrafficFigures | None
    events: list[Event]
    samples: dict[str, list[tuple[float, Sample]]]
    legs: list[FlownLeg]
    emission: dict[str, list[tuple[float, float]]]
    end_s: float
    missing: list[str]

    @property
    def outcome(self) -> str:
        """The verdict; "unfinished" when the service ended before it could give one."""
        return "unfinished" if self.result is None else self.result.outcome

    @property
    def receivers(self) -> list[str]:
        """The receivers in the order of the plan."""
        return [route.receiver for route in self.plan.routes]

    @property
    def tracks(self) -> dict[str, list[complex]]:
        """Where each receiver was in flight, formation frame, m."""
        return {
            name: [complex(*sample.at_m) for _, sample in samples if sample.at_m is not None]
            for name, samples in self.samples.items()
        }


def load_run(folder: Path) -> RunData:
    """Return the run in a folder. ServiceError when it holds no playbook and plan, or what is there is not a run's."""
    missing: list[str] = []
    playbook = read_json(folder / "playbook.json", PlaybookPart)
    facts = _optional(folder / FACTS_FILE, RunFacts, missing)
    entries = list(_entries(_optional_lines(folder / "journal.jsonl", missing)))
    series = list(_series(_optional_lines(folder / "series.jsonl", missing)))
    times_ns = [time_ns for time_ns in map(_time_ns, entries) if time_ns is not None]
    times_ns += [line.time_ns for line in series]
    began_ns = facts.started_ns if facts is not None else min(times_ns, default=0)
    result = _optional(folder / "report.json", Result, missing)
    lasted_s = 0.0 if result is None else result.duration_s
    end_s = max([lasted_s, *((time_ns - began_ns) * 1e-9 for time_ns in times_ns)])
    samples, legs = _flown(series, began_ns)
    return RunData(
        folder=folder,
        playbook=playbook,
        playbook_text=read_text(folder / "playbook.json"),
        plan=_plan(folder / "plan.json"),
        facts=facts,
        result=result,
        traffic=_optional(folder / "traffic.json", TrafficFigures, missing),
        events=[_event(entry, began_ns) for entry in entries],
        samples=samples,
        legs=legs,
        emission=_emission(series, began_ns, end_s),
        end_s=end_s,
        missing=missing,
    )


_Kind = TypeVar("_Kind")


def _optional(path: Path, kind: type[_Kind], missing: list[str]) -> _Kind | None:
    if path.exists():
        return read_json(path, kind)
    missing.append(path.name)
    return None


def _optional_lines(path: Path, missing: list[str]) -> list[bytes]:
    if path.exists():
        return read_lines(path)
    missing.append(path.name)
    return []


def _plan(path: Path) -> RelayPlan:
    try:
        return plan_from_json(strict_json.read_any_json(read_text(path)))
    except (MalformedError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        raise ServiceError(f"{path} is not a plan: {error!r}") from error


def _entries(lines: Iterable[bytes]) -> Iterator[dict[str, Any]]:
    """Yield what stands in a journal; the last line of a killed service may not be whole."""
    for line in lines:
        with contextlib.suppress(msgspec.MsgspecError):
            yield strict_json.read_json(line, dict[str, Any])


def _series(lines: Iterable[bytes]) -> Iterator[SeriesLine]:
    for line in lines:
        with contextlib.suppress(msgspec.MsgspecError):
            yield read_line(line)


def _time_ns(entry: Mapping[str, Any]) -> int | None:
    time_ns = entry.get("time_ns")
    return time_ns if isinstance(time_ns, int) and abs(time_ns) < _LATEST_NS else None


def _event(entry: Mapping[str, Any], began_ns: int) -> Event:
    """Return an entry of the journal; what is no change of a receiver is shown as it stands."""
    named = {key: str(entry.get(key, "")) for key in ("receiver", "state", "reason")}
    others = {key: value for key, value in entry.items() if key not in (*named, "time_ns", "slot", "known")}
    text = " ".join([named["reason"], *(f"{key}: {value}" for key, value in others.items())]).strip()
    time_ns = _time_ns(entry)
    return Event(0.0 if time_ns is None else (time_ns - began_ns) * 1e-9, named["receiver"], named["state"], text)


def _flown(series: Iterable[SeriesLine], began_ns: int) -> tuple[dict[str, list[tuple[float, Sample]]], list[FlownLeg]]:
    """Return the samples of each receiver, and the legs with the samples that were taken on them."""
    samples: dict[str, list[tuple[float, Sample]]] = defaultdict(list)
    legs: list[FlownLeg] = []
    flying: dict[str, FlownLeg] = {}
    for line in series:
        time_s = (line.time_ns - began_ns) * 1e-9
        if isinstance(line, LegBegun):
            flying[line.receiver] = FlownLeg(line, time_s)
            legs.append(flying[line.receiver])
        elif isinstance(line, LegEnded):
            for leg in legs:
                if (leg.begun.receiver, leg.begun.number, leg.end_s) == (line.receiver, line.number, None):
                    leg.end_s, leg.stop_angle_error_rad = time_s, line.stop_angle_error_rad
        elif isinstance(line, Tick):
            for name, sample in line.receivers.items():
                samples[name].append((time_s, sample))
                if sample.angle_rad is not None and name in flying:
                    flying[name].samples.append((time_s, sample))
    return dict(samples), legs


def _emission(series: Iterable[SeriesLine], began_ns: int, end_s: float) -> dict[str, list[tuple[float, float]]]:
    on_since: dict[str, float] = {}
    intervals: dict[str, list[tuple[float, float]]] = defaultdict(list)
    switched = (line for line in series if isinstance(line, Switched))
    for line in switched:
        time_s = (line.time_ns - began_ns) * 1e-9
        if line.on:
            on_since.setdefault(line.transmitter, time_s)
        elif line.transmitter in on_since:
            intervals[line.transmitter].append((on_since.pop(line.transmitter), time_s))
    for name, since_s in on_since.items():
        intervals[name].append((since_s, end_s))
    return {name: intervals[name] for name in sorted(intervals)}


def state_intervals(data: RunData, receiver: str) -> Iterator[tuple[str, float, float]]:
    """Yield every state of a receiver, from when until when, s since the run began."""
    state, since_s = "WAITING", 0.0
    for event in data.events:
        if event.receiver == receiver and event.state and event.state != state:
            yield state, since_s, event.time_s
            state, since_s = event.state, event.time_s
    yield state, since_s, data.end_s
