"""The service: one run of a playbook from links to report. All effects meet here."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import PositionReport, Progress, encode
from drivers.bus.session import Bus
from drivers.clock import Clock, SystemClock
from drivers.errors import DriverError
from drivers.mavlink.tlog import open_tlogs
from drivers.mavlink.vehicle import Kinematics
from drivers.simulation.launcher import SimulatedTime, process_group
from drivers.simulation.sitl import SITLS, Sitl
from drivers.tasks import background
from gcs.bearings import BearingFeed
from gcs.clock_offsets import ClockOffsets
from gcs.control import STOPPED, ControlDesk
from gcs.errors import ServiceError, leaves
from gcs.fleet import Member, cleared_to_arm, in_guided_flight
from gcs.guidance import SpeedLimits
from gcs.links import FleetLinks, open_links
from gcs.playbook.schema import Playbook
from gcs.preflight.report import PreflightError
from gcs.recording.bus_address import FILE as BUS_FILE
from gcs.recording.bus_address import BusAddress
from gcs.recording.facts import FILE as FACTS_FILE
from gcs.recording.facts import RunFacts
from gcs.recording.flight import Recording, open_recording
from gcs.recording.journal import Journal, open_journal
from gcs.recording.lines import open_lines
from gcs.recording.run_folder import RunFolder
from gcs.recording.score import Score
from gcs.recording.series import Series
from gcs.recording.versions import versions
from gcs.relay.emission import EmissionControl
from gcs.relay.executor import RelayExecutor
from gcs.relay.records import ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.reports.figure import draw_plan
from gcs.reports.page import write_report
from gcs.reports.run_report import Outcome, RunFigures, run_report
from gcs.run_bus import joined, start_router
from gcs.safety import PositionBoard, Safety, SafetyLimits, SitePosition
from gcs.simulated_sensors import start_sensors
from gcs.simulated_vehicles import start_vehicles
from gcs.status import RunStatus
from planner.frames import SiteFrame
from planner.plan import RelayPlan, plan_to_json

Show = Callable[[RunStatus], contextlib.AbstractAsyncContextManager[None]]
"""Puts the status of a run on a screen for as long as its block lasts."""


@dataclass(frozen=True)
class RunOptions:
    """What the command line adds to a playbook."""

    runs_dir: Path = Path("runs")
    speedup: float = 1.0
    seed: int = 0
    sitl: str | None = None
    """Fly on this autopilot's own simulator, in real time, instead of embedded copters."""
    attended: bool = False
    """Whether somebody is there to give the word when the relay holds; otherwise it ends."""


@dataclass(frozen=True)
class RunResult:
    """What a run yields."""

    report: dict[str, Any]
    folder: RunFolder
    figure: Path


@dataclass
class _Run:
    """Everything one run holds while it lasts."""

    playbook: Playbook
    plan: RelayPlan
    options: RunOptions
    clock: Clock
    bus: Bus
    journal: Journal
    status: RunStatus
    fleet: FleetLinks
    board: PositionBoard = field(default_factory=PositionBoard)

    @property
    def keys(self) -> SwarmKeys:
        return SwarmKeys(self.playbook.name)


async def fly(playbook: Playbook, plan: RelayPlan, options: RunOptions, show: Show) -> RunResult:
    """Fly a relay plan on the playbook's vehicles and return the report, which is also in the run folder.

    A vehicle that cannot be brought up ends the run as "failed"; anything that goes wrong later holds the vehicles and
    ends it as "aborted". Raises ServiceError, DriverError when the run cannot even begin.
    """
    if playbook.vehicles is not None and options.speedup != 1.0:
        raise ServiceError("--speedup is for embedded copters only: this playbook names the links of its vehicles")
    sitl = _sitl(playbook, options)
    if playbook.sensor.reference != "true_north":
        raise ServiceError("legs are flown along north-referenced bearings: sensor.reference must be true_north")
    sim_time = SimulatedTime(options.speedup, time.time_ns())
    clock = SystemClock(sim_time.speedup, sim_time.epoch_ns)
    folder = RunFolder.create(options.runs_dir, playbook.name)
    folder.write_json("playbook.json", playbook.model_dump(mode="json"))
    folder.write_json("plan.json", plan_to_json(plan))
    facts = RunFacts(sim_time.epoch_ns, sim_time.speedup, options.seed, options.sitl, versions())
    folder.write_json(FACTS_FILE, msgspec.to_builtins(facts))
    status = RunStatus(playbook.name, clock)
    status.say(f"run folder {folder.path}")
    async with contextlib.AsyncExitStack() as stack:
        await stack.enter_async_context(show(status))
        journal = stack.enter_context(open_journal(folder.path / "journal.jsonl"))
        group = await stack.enter_async_context(process_group(folder.logs))
        endpoint = playbook.bus.router or await start_router(group)
        bus = await stack.enter_async_context(joined(endpoint))
        folder.write_json(BUS_FILE, msgspec.to_builtins(BusAddress(endpoint, playbook.name)))
        tlogs = await stack.enter_async_context(open_tlogs(folder.path / "tlogs", clock))
        fleet = await stack.enter_async_context(open_links(playbook, clock, sitl, tlogs))
        run = _Run(playbook, plan, options, clock, bus, journal, status, fleet)
        status.recording = lambda: tlogs.problem
        status.links = lambda: fleet.statuses(clock.now_s())
        for vehicle in fleet.vehicles.values():
            vehicle.on_notice.append(status.say)
        if playbook.vehicles is None:
            status.phase = "starting the vehicles"
            await start_vehicles(playbook, fleet.vehicles, group, sim_time, sitl)
        if playbook.sensor.is_simulated(vehicles_named=playbook.vehicles is not None):
            await start_sensors(playbook, options.seed, group, endpoint, sim_time)
        recording = await stack.enter_async_context(_recorded(run, folder))
        report, score = await _relay(run, recording)
    folder.write_json("report.json", report)
    figure = folder.path / "figure.svg"
    places = {name: transmitter.at for name, transmitter in playbook.transmitters.items()}
    draw_plan(plan, places, figure, tracks=score.tracks, title=playbook.name)
    try:
        write_report(folder.path)
    except ServiceError as error:
        status.say(str(error))
    return RunResult(report, folder, figure)


@contextlib.asynccontextmanager
async def _recorded(run: _Run, folder: RunFolder) -> AsyncIterator[Recording]:
    """Record what is said on the bus and what the receivers measure, while the block lasts."""
    status, bus, clock = run.status, run.bus, run.clock
    with open_lines(folder.path / "series.jsonl", synced=False) as lines:
        series = Series(lines, status, run.board, run.playbook.site.frame, clock)
        series.attach(bus, run.keys)
        async with (
            open_recording(folder.path, bus, run.keys, clock, status.say) as recording,
            background(series.record()),
        ):
            yield recording


def _sitl(playbook: Playbook, options: RunOptions) -> Sitl | None:
    """Return the simulator asked for. ServiceError when it cannot fly this, SimulationError when the user has none."""
    if options.sitl is None:
        return None
    if playbook.vehicles is not None or options.speedup != 1.0:
        raise ServiceError("--sitl starts the vehicles itself, in real time: leave out 'vehicles' and --speedup")
    sitl = SITLS[options.sitl]
    sitl.find()
    return sitl


async def _relay(run: _Run, recording: Recording) -> tuple[dict[str, Any], Score]:
    """Bring the vehicles up, run the relay, and return report and score."""
    playbook, clock, status, frame = run.playbook, run.clock, run.status, run.playbook.site.frame
    settings = _settings(playbook)
    clocks = ClockOffsets(playbook.receivers, clock, status.say)
    clocks.attach(run.bus, run.keys)
    feed = BearingFeed(playbook.receivers, frame, clock, settings.gap_s, clocks, playbook.sensor.reference)
    feed.attach(run.bus, run.keys)
    emission = EmissionControl(run.bus, run.keys, clock)
    records = {route.receiver: ReceiverRecord(route) for route in run.plan.routes}
    score = Score(frame, run.board, records)
    status.records = records
    _publish_positions(run, score)
    outcome: Outcome = "failed"
    async with _failures_said(status), background(clocks.run()):
        status.phase = "preflight"
        autopilots = await cleared_to_arm(playbook, run.plan, run.fleet.vehicles, status.say)
        status.phase = "taking off"
        async with in_guided_flight(playbook, run.fleet.vehicles, autopilots, clock) as members:
            executor = RelayExecutor(
                records,
                {name: transmitter.at for name, transmitter in playbook.transmitters.items()},
                leases={name: member.stream for name, member in members.items()},
                feed=feed,
                emission=emission,
                frame=frame,
                clock=clock,
                settings=settings,
                objection=_safety(run).objection,
                announce=_announcer(run, emission),
                say=_teller(run),
                problem=playbook.problem(),
                attended=run.options.attended,
            )
            _serve_control(run, executor, recording)
            status.relay, status.phase, outcome = executor, "relay", "aborted"
            try:
                with _stopping_on_interrupt(executor, status):
                    await executor.run()
            finally:
                await clock.sleep(playbook.flight.lease_s)  # the last zero velocities go out
            outcome = "formed" if executor.formed else "aborted"
            if executor.formed and playbook.flight.land_after:
                await _land(run, members)
    status.phase = outcome
    figures = RunFigures(
        playbook.name, outcome, status.elapsed_s(), emission.transmitter_s(), feed.counters, status.links()
    )
    return run_report(figures, run.plan, records, score), score


def _serve_control(run: _Run, executor: RelayExecutor, recording: Recording) -> None:
    """Answer the operator on the bus from now on."""
    desk = ControlDesk(executor, _teller(run))

    def answer(payload: bytes) -> bytes:
        reply = desk.answer(payload)
        recording.note_control(run.keys, payload, reply)
        return reply

    run.bus.serve(run.keys.control, answer)


@contextlib.asynccontextmanager
async def _failures_said(status: RunStatus) -> AsyncIterator[None]:
    """Put what goes wrong with a vehicle in the block before the operator; the run goes on to its report."""
    try:
        yield
    except* (DriverError, PreflightError) as failures:
        for failure in leaves(failures):
            status.say(str(failure))


async def _land(run: _Run, members: dict[str, Member]) -> None:
    run.status.phase = "landing"
    async with asyncio.TaskGroup() as group:
        for member in members.values():
            group.create_task(member.autopilot.land(member.vehicle))


def _settings(playbook: Playbook) -> RelaySettings:
    flight = playbook.flight
    return RelaySettings(
        limits=SpeedLimits(speed_mps=flight.speed_mps),
        min_separation_m=playbook.planner.min_separation_m,
        placement_tolerance_m=flight.placement_tolerance_m,
        give_up_s=flight.give_up_s,
    )


def _safety(run: _Run) -> Safety:
    return Safety(
        vehicles=run.fleet.vehicles,
        bus_connected=run.bus.connected,
        limits=SafetyLimits(min_separation_m=run.playbook.planner.min_separation_m),
        positions=run.board,
        places={
            name: run.playbook.site.frame.to_site(transmitter.at)
            for name, transmitter in run.playbook.transmitters.items()
        },
    )


def _publish_positions(run: _Run, score: Score) -> None:
    """Put every vehicle's position on the board and the bus from now on: for safety, screens, score and simulation."""
    site = SiteFrame(run.playbook.site.origin)

    def publisher(name: str) -> Callable[[Kinematics], None]:
        def publish(kinematics: Kinematics) -> None:
            north_east, down_m = site.from_geodetic(kinematics.position)
            north_mps, east_mps, _ = kinematics.velocity_ned_mps
            run.board.latest[name] = SitePosition(kinematics.time_s, north_east, -down_m)
            score.moved(name)
            report = PositionReport(run.clock.unix_ns(), north_east.real, north_east.imag, down_m, north_mps, east_mps)
            run.bus.put_latest(run.keys.position(name), encode(report))

        return publish

    for name, vehicle in run.fleet.vehicles.items():
        vehicle.on_kinematics.append(publisher(name))


def _announcer(run: _Run, emission: EmissionControl) -> Callable[[ReceiverRecord], None]:
    """Return what tells journal, bus and screen of every change of a receiver."""

    def announce(record: ReceiverRecord) -> None:
        run.status.on_air = emission.on_air
        run.status.say(f"{record.name} {record.state.value}" + (f": {record.reason}" if record.reason else ""))
        now_ns = run.clock.unix_ns()
        run.journal.append(
            {
                "time_ns": now_ns,
                "receiver": record.name,
                "slot": record.route.slot,
                "state": record.state.value,
                "reason": record.reason,
            }
        )
        progress = Progress(now_ns, record.name, record.state.value, record.reason)
        run.bus.put_history(run.keys.progress, encode(progress))

    return announce


def _teller(run: _Run) -> Callable[[str], None]:
    """Return what tells journal and screen what concerns the relay as a whole, and the operator's words."""

    def tell(text: str) -> None:
        run.status.say(text)
        run.journal.append({"time_ns": run.clock.unix_ns(), "relay": text})

    return tell


@contextlib.contextmanager
def _stopping_on_interrupt(executor: RelayExecutor, status: RunStatus) -> Iterator[None]:
    """Let Ctrl-C hold every vehicle and end the run in order."""

    def interrupt() -> None:
        status.say("stopped by the operator: every vehicle holds")
        executor.abort(STOPPED)

    loop = asyncio.get_running_loop()
    for signal_number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(signal_number, interrupt)
    try:
        yield
    finally:
        for signal_number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(signal_number)
