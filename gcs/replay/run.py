"""A run, replayed: every message of its recording in order, and every stop monitor told again what it was told."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from drivers.bus.keys import uav_of
from drivers.bus.messages import BearingReport, MalformedMessageError
from drivers.strict_json import MalformedError, read_any_json
from gcs.errors import ServiceError
from gcs.recording.facts import FILE as FACTS_FILE
from gcs.recording.facts import RunFacts
from gcs.recording.mcap_reading import Recorded, read_flight
from gcs.recording.topics import decoded, monitored
from gcs.relay.records import ReceiverRecord
from gcs.replay.bus_audit import BusAudit
from gcs.replay.monitors import Flight, MonitorReplay
from gcs.replay.settings import Changes
from gcs.reports.run_files import read_json, read_text
from gcs.traced_monitor import MonitorNote
from planner.frames import FormationFrame
from planner.plan import plan_from_json


class _Site(msgspec.Struct, frozen=True):
    axis_azimuth_deg: float


class _PlaybookPart(msgspec.Struct, frozen=True):
    """What a replay needs of a playbook."""

    name: str
    site: _Site


@dataclass
class RunReplay:
    """The run in a folder. Take `messages` to their end: then every flight has been replayed.

    `complaints` says what of the recording cannot be vouched for. ServiceError when the folder is not a run's.
    """

    folder: Path
    changes: Changes
    complaints: list[str] = field(default_factory=list)
    monitors: dict[str, MonitorReplay] = field(default_factory=dict)
    """The latest monitor of each receiver."""
    began_ns: int = 0
    _all: list[MonitorReplay] = field(default_factory=list)

    def __post_init__(self) -> None:
        playbook = read_json(self.folder / "playbook.json", _PlaybookPart)
        self.name = playbook.name
        self.audit = BusAudit(FormationFrame(math.radians(playbook.site.axis_azimuth_deg)))
        if (self.folder / FACTS_FILE).exists():
            self.began_ns = read_json(self.folder / FACTS_FILE, RunFacts).started_ns

    @property
    def flights(self) -> list[Flight]:
        """Every flight along a leg, in the order they began."""
        return sorted((flight for monitor in self._all for flight in monitor.flights), key=lambda each: each.began_ns)

    @property
    def sound(self) -> bool:
        """Whether the record is whole, and every decision came out of it as it was taken."""
        return not self.complaints and not self.audit.unsaid and all(flight.identical for flight in self.flights)

    def records(self) -> dict[str, ReceiverRecord]:
        """Return every receiver of the plan, before anything has happened. ServiceError when there is no plan."""
        path = self.folder / "plan.json"
        try:
            plan = plan_from_json(read_any_json(read_text(path)))
        except (MalformedError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
            raise ServiceError(f"{path} is not a plan: {error!r}") from error
        return {route.receiver: ReceiverRecord(route) for route in plan.routes}

    def since_began_s(self, time_ns: int) -> float:
        """Return when something was recorded, s since the run began."""
        return (time_ns - self.began_ns) * 1e-9

    def messages(self) -> Iterator[tuple[Recorded, object]]:
        """Yield every message and what it holds, once it has been replayed. ServiceError when there is no recording."""
        for message in read_flight(self.folder, self.complaints.append):
            self.began_ns = self.began_ns or message.time_ns
            try:
                said = decoded(message.payload, message.topic)
            except MalformedMessageError as error:
                self.complaints.append(f"{message.topic}: a message is not what its schema promises: {error}")
                continue
            self._take(message, said)
            yield message, said

    def _take(self, message: Recorded, said: object) -> None:
        if isinstance(said, BearingReport):
            self.audit.said(uav_of(message.topic) or "", said)
        receiver = monitored(message.topic)
        if receiver is None or not isinstance(said, MonitorNote):
            return
        try:
            self._note(receiver, said, message.time_ns)
        except (ArithmeticError, LookupError, ValueError) as error:
            self._complain_once(f"{message.topic}: a note makes no sense to a stop monitor: {error!r}")

    def _note(self, receiver: str, note: MonitorNote, time_ns: int) -> None:
        if note.made is not None:
            self.monitors[receiver] = MonitorReplay(receiver, note.made, note.time_s, self.changes)
            self._all.append(self.monitors[receiver])
        elif receiver in self.monitors:
            self.monitors[receiver].take(note, time_ns)
        else:
            self._complain_once(f"{receiver}: how its first stop monitor was made is not in the recording")
        if note.observed is not None:
            self.audit.taken(receiver, note.observed)

    def _complain_once(self, complaint: str) -> None:
        if complaint not in self.complaints:
            self.complaints.append(complaint)
