"""One run: everything it holds while it lasts. The service opens it, its stages change it, and nothing else does."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Coroutine, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from drivers.bus.keys import SwarmKeys
from drivers.bus.session import Bus
from drivers.clock import Clock
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.setpoints import StreamState
from drivers.mavlink.vehicle import Heartbeat
from drivers.tasks import StartTask
from gcs.bearings import BearingFeed
from gcs.clock_offsets import ClockOffsets
from gcs.errors import ServiceError
from gcs.expectations import Verdict
from gcs.fleet import Member
from gcs.links import FleetLinks
from gcs.nodes.remote_stream import RemoteStream
from gcs.playbook.schema import Playbook
from gcs.recording.journal import Journal, relay_line
from gcs.recording.run_folder import RunFolder
from gcs.recording.score import Score
from gcs.relay.emission import EmissionControl
from gcs.relay.executor import RelayExecutor
from gcs.relay.records import ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.reports.run_report import Outcome, RunFigures, run_report
from gcs.resume.earlier import Earlier, with_earlier
from gcs.resume.state import Restored
from gcs.safety import PositionBoard, Safety, SafetyLimits
from gcs.stages.operator import Operator
from gcs.stages.simulation import Simulation
from gcs.status import RunStatus
from gcs.takeovers import Takeovers
from gcs.traced_monitor import Trace, untraced
from planner.plan import RelayPlan, plan_to_json

StageOutcome = Literal["done", "failed", "stopped", "not_reached"]

FOR_THE_PLAYBOOK = ""
"""Who needs the transmitters that an emission stage keeps on: nobody is called that."""


def not_begun(coroutine: Coroutine[Any, Any, None]) -> None:
    """Start nothing: the stages are not being run."""
    coroutine.close()
    raise RuntimeError("nothing is started before the stages")


class StageError(ServiceError):
    """A stage could not be done: what is wrong, and the way out."""


@dataclass(frozen=True)
class StageResult:
    """What became of a stage; times are s since the run began."""

    name: str
    kind: str
    outcome: StageOutcome
    began_s: float | None = None
    ended_s: float | None = None
    reason: str = ""


@dataclass
class Sent:
    """A vehicle sent from one mode into a mode of its own: it is somebody else's from when it is in yet another one."""

    leaving: int | None
    taken: bool = False
    _mode: int | None = None

    def watch(self, heartbeat: Heartbeat) -> None:
        """Notice a mode that it was not sent into."""
        if self._mode is None and heartbeat.custom_mode != self.leaving:
            self._mode = heartbeat.custom_mode
        self.taken = self.taken or self._mode not in (None, heartbeat.custom_mode)


@dataclass
class Run:
    """One run. What follows `start` is what its stages have brought about so far."""

    playbook: Playbook
    plan: RelayPlan
    values: Mapping[str, Any]
    """What of the playbook's matrix it is."""
    clock: Clock
    bus: Bus
    folder: RunFolder
    journal: Journal
    status: RunStatus
    fleet: FleetLinks
    board: PositionBoard
    clocks: ClockOffsets
    feed: BearingFeed
    emission: EmissionControl
    records: dict[str, ReceiverRecord]
    score: Score
    operator: Operator
    simulation: Simulation
    elsewhere: Mapping[str, RemoteStream] = field(default_factory=dict)
    """The streams of the vehicles on link nodes."""
    takeovers: Takeovers = field(default_factory=lambda: Takeovers(Counter()))
    """What is sent to vehicles that their pilots have."""
    start: StartTask = not_begun
    """Starts what goes on beside the stages, until the last of them has ended."""
    trace: Trace = untraced
    """Records what stop monitors are told and what they answer."""

    autopilots: Mapping[str, Autopilot] = field(default_factory=dict)
    """How each vehicle is flown, once the preflight has cleared it."""
    members: dict[str, Member] = field(default_factory=dict)
    """The vehicles that were brought into guided flight."""
    sent: dict[str, Sent] = field(default_factory=dict)
    """The vehicles that hold, or return, by a mode of their own."""
    located: dict[str, complex] = field(default_factory=dict)
    """Where bearings put the receivers before the relay, formation frame, m."""
    kept_on: set[str] = field(default_factory=set)
    """The transmitters that are on the air whether the relay needs them or not."""
    resumed: Restored | None = None
    """What it goes on from, where an earlier service flew it..."""
    earlier: Earlier | None = None
    """...and what was flown then."""
    relay: RelayExecutor | None = None
    """The relay, from when it is flown on."""
    halt: Callable[[str], object] | None = None
    """Ends the stage under way in its own order, with a reason; None: it is just given up."""
    stage: str = ""
    """The name of the stage under way."""
    placement_errors_m: dict[str, float | None] = field(default_factory=dict)
    """How far from its slot each receiver said it stood when the relay ended."""
    results: list[StageResult] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    measurements: list[dict[str, Any]] = field(default_factory=list)

    @property
    def keys(self) -> SwarmKeys:
        """The keys of its swarm."""
        return SwarmKeys(self.playbook.name)

    @property
    def settings(self) -> RelaySettings:
        """How its relay is flown."""
        return RelaySettings.of(self.playbook.flight, self.playbook.planner.min_separation_m)

    @property
    def outcome(self) -> Outcome:
        """What became of it so far: formed, completed where it has no relay, aborted, or failed before any relay."""
        stopped = any(result.outcome == "stopped" for result in self.results)
        if self.relay is not None:
            return "formed" if self.relay.formed else "aborted"
        if any(stage.kind == "relay" for stage in self.playbook.flow) or stopped:
            return "aborted" if stopped else "failed"
        return "completed" if all(result.outcome == "done" for result in self.results) else "failed"

    def tell(self, text: str) -> None:
        """Put before whoever watches, and into the journal, what is done about the run as a whole."""
        self.status.say(text)
        taken, given_up = (None, None) if self.relay is None else (self.relay.taken, self.relay.given_up)
        self.journal.append(relay_line(self.clock.unix_ns(), text, taken, given_up))

    def adopt(self, plan: RelayPlan) -> None:
        """Fly another plan from now on."""
        self.plan = plan
        self.folder.write_json("plan.json", plan_to_json(plan))
        self.records.clear()
        self.records |= {route.receiver: ReceiverRecord(route) for route in plan.routes}

    def safety(self) -> Safety:
        """Return what forbids a vehicle to move."""
        frame, transmitters = self.playbook.site.frame, self.playbook.transmitters
        return Safety(
            vehicles=self.fleet.vehicles,
            bus_connected=self.bus.connected,
            limits=SafetyLimits.of(self.playbook.flight, self.playbook.planner.min_separation_m),
            positions=self.board,
            places={name: frame.to_site(transmitter.at) for name, transmitter in transmitters.items()},
            battery_percent=self._battery_percent,
            fence=[frame.to_site(corner) for corner in self.playbook.planner.fence],
        )

    def _battery_percent(self, name: str) -> int | None:
        battery = self.fleet.vehicles[name].telemetry.battery
        return None if battery is None else battery.percent

    def flying(self) -> Iterator[str]:
        """Yield the vehicles in the air, or armed, that are the service's to command: never a pilot's."""
        for name, vehicle in self.fleet.vehicles.items():
            if vehicle.armed and name in self.autopilots and self._is_ours(name, vehicle.telemetry.heartbeat):
                yield name

    def pilots(self) -> list[str]:
        """Return the vehicles in the air that are not the service's to command."""
        ours = set(self.flying())
        return [name for name, vehicle in self.fleet.vehicles.items() if vehicle.armed and name not in ours]

    def send(self, name: str) -> None:
        """Keep in mind that a vehicle is being sent into a mode of its own."""
        vehicle = self.fleet.vehicles[name]
        self.sent[name] = Sent(vehicle.custom_mode)
        vehicle.on_heartbeat.append(self.sent[name].watch)

    def brake(self, name: str) -> None:
        """Stop a vehicle that is not moved by a stream, by a mode of its own."""
        self.send(name)
        self.autopilots[name].hold(self.fleet.vehicles[name])

    def stop_all(self) -> None:
        """Stop every vehicle that moves on a lease."""
        for member in self.members.values():
            if member.stream.state is StreamState.LEASED:
                member.stream.stop()

    def _is_ours(self, name: str, heartbeat: Heartbeat | None) -> bool:
        if name in self.sent:
            return not self.sent[name].taken
        if name in self.members:
            return self.members[name].stream.state is not StreamState.PILOT
        return heartbeat is not None and self.autopilots[name].is_guided(heartbeat)

    def require_cleared(self) -> None:
        """Return when the preflight has cleared every vehicle; StageError when it has not."""
        if missing := [name for name in self.fleet.vehicles if name not in self.autopilots]:
            raise StageError(f"nothing is armed: {', '.join(missing)} was not cleared by a preflight")

    def require_in_flight(self) -> None:
        """Return when every vehicle is in guided flight; StageError when one is not."""
        done_without = frozenset[str]() if self.resumed is None else self.resumed.given_up
        if missing := [name for name in self.fleet.vehicles if name not in self.members and name not in done_without]:
            raise StageError(f"{', '.join(missing)} is not in guided flight: see the takeoff")

    def report(self) -> dict[str, Any]:
        """Return report.json as far as the run has come."""
        figures = RunFigures(
            self.playbook.name,
            self.outcome,
            self.status.elapsed_s(),
            self.emission.transmitter_s(),
            self.feed.counters,
            self.status.links(),
            [vars(result) for result in self.results],
            self.verdicts,
            self.takeovers.of_receivers(self.records),
        )
        made = run_report(figures, self.plan, self.records, self.score)
        if self.earlier is not None:
            made = with_earlier(made, self.earlier)
        for receiver in made["receivers"]:
            receiver["placement_error_m"] = self.placement_errors_m.get(receiver["name"], receiver["placement_error_m"])
        beside = {"target": self.playbook.target, "seed": self.playbook.seed, "matrix": dict(self.values)}
        return made | beside | {"measurements": list(self.measurements)}
