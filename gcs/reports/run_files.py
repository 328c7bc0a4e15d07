"""The JSON files of a run's folder, in as far as the report needs them; what else is in them does not matter."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import msgspec

from drivers import strict_json
from drivers.bus.refusals import Refusals
from gcs.errors import ServiceError
from gcs.expectations.verdicts import Verdict


class PlacedTransmitter(msgspec.Struct, frozen=True):
    """A transmitter of the playbook, formation frame, m."""

    at: tuple[float, float]


class PlannerPart(msgspec.Struct, frozen=True):
    """What the report needs of the planner's section."""

    min_separation_m: float


class PlaybookPart(msgspec.Struct, frozen=True):
    """What the report needs of a playbook."""

    name: str
    transmitters: dict[str, PlacedTransmitter]
    planner: PlannerPart


class LegResult(msgspec.Struct, frozen=True):
    """A leg in report.json."""

    planned_length_m: float
    flown_length_m: float | None = None
    stop_angle_error_deg: float | None = None


class ReceiverResult(msgspec.Struct, frozen=True):
    """A receiver in report.json."""

    name: str
    slot: str
    state: str
    reason: str
    route_model: str
    placement_error_m: float | None
    legs: list[LegResult]


class StageResult(msgspec.Struct, frozen=True):
    """A stage in report.json; it began and ended at s since the run began."""

    name: str
    kind: str
    outcome: str
    began_s: float | None = None
    ended_s: float | None = None
    reason: str = ""


class Hovered(msgspec.Struct, frozen=True):
    """How far from its slot a receiver hovered during a measurement, m."""

    mean_m: float
    median_m: float
    rms_m: float
    max_m: float


class Measurement(msgspec.Struct, frozen=True):
    """A `measure` stage in report.json."""

    stage: str
    duration_s: float
    receivers: dict[str, Hovered]


class Result(msgspec.Struct, frozen=True):
    """report.json."""

    outcome: str
    planned_total_length_m: float
    flown_total_length_m: float
    straight_line_bound_m: float
    min_separation_m: float | None
    duration_s: float
    emission_transmitter_s: float
    bearing_reports: dict[str, int]
    receivers: list[ReceiverResult]
    links: list[dict[str, Any]] = []
    stages: list[StageResult] = []
    verdicts: list[Verdict] = []
    measurements: list[Measurement] = []
    refused_on_bus: Refusals = Refusals()


class KeyFigures(msgspec.Struct, frozen=True):
    """One key of the bus in traffic.json."""

    messages: int
    unreadable: int
    size_bytes: int
    rate_hz: float | None
    longest_gap_s: float | None


class SensorFigures(msgspec.Struct, frozen=True):
    """One sensor in traffic.json."""

    reports: int
    bearings: int
    missing: int
    mean_age_s: float
    longest_age_s: float


class TrafficFigures(msgspec.Struct, frozen=True):
    """traffic.json."""

    files: list[str]
    dropped: int
    stopped: str | None
    keys: dict[str, KeyFigures]
    sensors: dict[str, SensorFigures]


_Kind = TypeVar("_Kind")


def read_text(path: Path) -> str:
    """Return the text of a file; ServiceError when it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ServiceError(f"{path} cannot be read: {error}. Is {path.parent} the folder of a run?") from error


def read_json(path: Path, kind: type[_Kind]) -> _Kind:
    """Return what a JSON file holds; ServiceError when it holds nothing of the kind."""
    try:
        return strict_json.read_json(read_text(path), kind)
    except msgspec.MsgspecError as error:
        raise ServiceError(f"{path} is not what a run leaves behind: {error}") from error


def read_lines(path: Path) -> list[bytes]:
    """Return the lines of a file; ServiceError when it cannot be read."""
    try:
        return path.read_bytes().splitlines()
    except OSError as error:
        raise ServiceError(f"{path} cannot be read: {error}") from error
