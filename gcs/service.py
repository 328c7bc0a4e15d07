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

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import PositionReport, Progress, encode
from drivers.bus.session import Bus
from drivers.clock import Clock, SystemClock
from drivers.errors import DriverError
from drivers.mavlink.vehicle import Kinematics, Vehicle
from drivers.simulation.launcher import SimulatedTime, process_group
from drivers.simulation.sitl import SITLS, Sitl
from gcs.bearings import BearingFeed
from gcs.errors import ServiceError, leaves
from gcs.fleet import Member, in_guided_flight, open_links, start_vehicles
from gcs.guidance import SpeedLimits
from gcs.playbook.schema import Playbook
from gcs.recording.journal import Journal, open_journal
from gcs.recording.run_folder import RunFolder
from gcs.recording.score import Score
from gcs.relay.emission import EmissionControl
from gcs.relay.executor import RelayExecutor
from gcs.relay.records import ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.reports.figure import draw_plan
from gcs.reports.run_report import Outcome, RunFigures, run_report
from gcs.run_bus import joined, start_router
from gcs.safety import PositionBoard, Safety, SafetyLimits, SitePosition
from gcs.simulated_sensors import start_sensors
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
    vehicles: dict[str, Vehicle]
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
    status = RunStatus(playbook.name, clock)
    status.say(f"run folder {folder.path}")
    async with contextlib.AsyncExitStack() as stack:
        await stack.enter_async_context(show(status))
        journal = stack.enter_context(open_journal(folder.path / "journal.jsonl"))
        group = await stack.enter_async_context(process_group(folder.logs))
        endpoint = playbook.bus.router or await start_router(group)
        bus = await stack.enter_async_context(joined(endpoint))
        vehicles = await stack.enter_async_context(open_links(playbook, clock, sitl))
        run = _Run(playbook, plan, options, clock, bus, journal, status, vehicles)
        if playbook.vehicles is None:
            status.phase = "starting the vehicles"
            await start_vehicles(playbook, vehicles, group, sim_time, sitl)
            await start_sensors(playbook, options.seed, group, endpoint, sim_time)
        report, score = await _relay(run)
    folder.write_json("report.json", report)
    figure = folder.path / "figure.svg"
    places = {name: transmitter.at for name, transmitter in playbook.transmitters.items()}
    draw_plan(plan, places, figure, tracks=score.tracks, title=playbook.name)
    return RunResult(report, folder, figure)


def _sitl(playbook: Playbook, options: RunOptions) -> Sitl | None:
    """Return the simulator asked for. ServiceError when it cannot fly this, SimulationError when the user has none."""
    if options.sitl is None:
        return None
    if playbook.vehicles is not None or options.speedup != 1.0:
        raise ServiceError("--sitl starts the vehicles itself, in real time: leave out 'vehicles' and --speedup")
    sitl = SITLS[options.sitl]
    sitl.find()
    return sitl


async def _relay(run: _Run) -> tuple[dict[str, Any], Score]:
    """Bring the vehicles up, run the relay, and return report and score."""
    settings, frame = _settings(run.playbook), run.playbook.site.frame
    feed = BearingFeed(run.playbook.receivers, frame, run.clock, max_age_s=settings.gap_s)
    feed.attach(run.bus, run.keys)
    emission = EmissionControl(run.bus, run.keys, run.clock)
    records = {route.receiver: ReceiverRecord(route) for route in run.plan.routes}
    score = Score(frame, run.board, records)
    run.status.records = records
    _publish_positions(run, score)
    outcome: Outcome = "failed"
    run.status.phase = "taking off"
    async with _failures_said(run.status), in_guided_flight(run.playbook, run.vehicles, run.clock) as members:
        executor = RelayExecutor(
            records,
            {name: transmitter.at for name, transmitter in run.playbook.transmitters.items()},
            leases={name: member.stream for name, member in members.items()},
            feed=feed,
            emission=emission,
            frame=frame,
            clock=run.clock,
            settings=settings,
            objection=_safety(run).objection,
            announce=_announcer(run, emission),
        )
        run.status.phase, outcome = "relay", "aborted"
        try:
            with _stopping_on_interrupt(executor, run.status):
                await executor.run()
        finally:
            await run.clock.sleep(run.playbook.flight.lease_s)  # the last zero velocities go out
        outcome = "formed" if executor.formed else "aborted"
        if executor.formed and run.playbook.flight.land_after:
            await _land(run, members)
    run.status.phase = outcome
    figures = RunFigures(run.playbook.name, outcome, run.status.elapsed_s(), emission.transmitter_s(), feed.counters)
    return run_report(figures, run.plan, records, score), score


@contextlib.asynccontextmanager
async def _failures_said(status: RunStatus) -> AsyncIterator[None]:
    """Put what goes wrong with a vehicle in the block before the operator; the run goes on to its report."""
    try:
        yield
    except* DriverError as failures:
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
        vehicles=run.vehicles,
        bus_connected=run.bus.connected,
        limits=SafetyLimits(min_separation_m=run.playbook.planner.min_separation_m),
        positions=run.board,
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

    for name, vehicle in run.vehicles.items():
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
        run.bus.put_reliably(run.keys.progress, encode(progress))

    return announce


@contextlib.contextmanager
def _stopping_on_interrupt(executor: RelayExecutor, status: RunStatus) -> Iterator[None]:
    """Let Ctrl-C hold every vehicle and end the run in order."""

    def interrupt() -> None:
        status.say("stopped by the operator: every vehicle holds")
        executor.abort("stopped by the operator")

    loop = asyncio.get_running_loop()
    for signal_number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(signal_number, interrupt)
    try:
        yield
    finally:
        for signal_number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(signal_number)
