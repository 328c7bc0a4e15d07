"""The service: opens what a run needs, has its stages run, and leaves the report."""

from __future__ import annotations

import contextlib
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import PositionReport, encode
from drivers.bus.session import Bus, LiveBus
from drivers.clock import Clock, SystemClock
from drivers.errors import DriverError
from drivers.mavlink.tlog import open_tlogs
from drivers.mavlink.vehicle import Kinematics
from drivers.simulation.launcher import SimulatedTime, process_group
from drivers.simulation.sitl import SITLS, Sitl
from drivers.tasks import background, open_background
from gcs.bearings import BearingFeed
from gcs.clock_offsets import ClockOffsets
from gcs.errors import ServiceError, leaves
from gcs.expectations import suite_of, write_junit
from gcs.links import FleetLinks, open_links
from gcs.monitor.access import Token, read_tokens
from gcs.monitor.proven import ControlGuard
from gcs.monitor.watched import watched
from gcs.nodes.desk import NodeDesk
from gcs.nodes.serving import desk_of, shares_of
from gcs.playbook.schema import Playbook, Target
from gcs.playbook.target import aimed, patient
from gcs.recording.bus_address import FILE as BUS_FILE
from gcs.recording.bus_address import BusAddress
from gcs.recording.facts import FILE as FACTS_FILE
from gcs.recording.facts import RunFacts
from gcs.recording.flight import Recording, open_recording
from gcs.recording.journal import FILE as JOURNAL_FILE
from gcs.recording.journal import Journal, open_journal
from gcs.recording.lines import open_lines
from gcs.recording.run_folder import RunFolder
from gcs.recording.score import Score
from gcs.recording.series import Series
from gcs.recording.versions import versions
from gcs.refused_on_bus import RefusedOnBus
from gcs.relay.emission import EmissionControl
from gcs.relay.records import ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.reports.figure import draw_plan
from gcs.reports.page import write_report
from gcs.resume.left_run import LeftRun
from gcs.resume.resumption import Resumption
from gcs.run_bus import joined, start_router
from gcs.safety import PositionBoard, SitePosition
from gcs.separation import braking_way
from gcs.simulated_sensors import start_sensors
from gcs.simulated_vehicles import start_vehicles
from gcs.stages.flow import run_stages
from gcs.stages.operator import Operator, Terminal, stopping_on_interrupt
from gcs.stages.run import Run
from gcs.stages.simulation import Simulation, tapped
from gcs.status import RunStatus
from gcs.takeovers import CountingLogs, Takeovers
from planner.frames import SiteFrame
from planner.plan import RelayPlan, plan_to_json

Show = Callable[[RunStatus], contextlib.AbstractAsyncContextManager[None]]
"""Puts the status of a run on a screen for as long as its block lasts."""


@dataclass(frozen=True)
class RunOptions:
    """What the command line adds to a playbook."""

    runs_dir: Path = Path("runs")
    speedup: float = 1.0
    seed: int | None = None
    """Of the simulated noise, instead of the playbook's."""
    sitl: Target | None = None
    """Fly on this autopilot's own simulator, in real time, instead of the playbook's target."""
    attended: bool = False
    """Whether somebody is there to give the word when the run holds; otherwise it ends."""
    terminal: Terminal | None = None
    """Where he may give it besides `bearing-relay control`."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """What of the playbook's matrix this run is."""


@dataclass(frozen=True)
class RunResult:
    """What a run yields."""

    report: dict[str, Any]
    folder: RunFolder
    figure: Path
    unwritten: tuple[str, ...] = ()
    """What could not be written into the folder, and why."""


async def fly(playbook: Playbook, plan: RelayPlan, options: RunOptions, show: Show) -> RunResult:
    """Run the stages of a playbook on its target and return the report, which is also in the run folder.

    Whatever goes wrong in a stage ends the run in order, with a report. Raises ServiceError, DriverError when the run
    cannot even begin.
    """
    playbook, sitl = _on_target(playbook, options)
    sim_time = SimulatedTime(options.speedup, time.time_ns())
    folder = RunFolder.create(options.runs_dir, playbook.name)
    folder.write_json("playbook.json", playbook.model_dump(mode="json"))
    folder.write_json("plan.json", plan_to_json(plan))
    simulator = playbook.target if sitl is not None else None
    facts = RunFacts(sim_time.epoch_ns, sim_time.speedup, playbook.seed, simulator, versions())
    folder.write_json(FACTS_FILE, msgspec.to_builtins(facts))
    return await _serve(folder, folder.logs, playbook, plan, options, sim_time, sitl, show, None)


async def resume(left: LeftRun, without: frozenset[str], options: RunOptions, show: Show) -> RunResult:
    """Go on with a run whose service has ended, `without` some of its vehicles; the report is of all of it.

    Raises ServiceError, DriverError when it cannot go on, while its service still runs among others.
    """
    sim_time = SimulatedTime(1.0, left.facts.started_ns)
    folder, logs = RunFolder(left.folder), left.new_logs()
    return await _serve(folder, logs, left.playbook, left.plan, options, sim_time, None, show, Resumption(without))


async def _serve(
    folder: RunFolder,
    logs: Path,
    playbook: Playbook,
    plan: RelayPlan,
    options: RunOptions,
    sim_time: SimulatedTime,
    sitl: Sitl | None,
    show: Show,
    resumption: Resumption | None,
) -> RunResult:
    """Open what the run needs, have its stages run, and write the report; everything opened is closed again."""
    token = read_tokens(None, None).command
    clock = SystemClock(sim_time.speedup, sim_time.epoch_ns)
    status = RunStatus(playbook.name, clock)
    status.started_s -= (clock.unix_ns() - sim_time.epoch_ns) * 1e-9
    status.say(f"run folder {folder.path}")
    async with contextlib.AsyncExitStack() as stack:
        await stack.enter_async_context(show(status))
        journal = stack.enter_context(open_journal(folder.path / JOURNAL_FILE, status.say))
        group = await stack.enter_async_context(process_group(logs))
        endpoint = playbook.bus.router or await start_router(group)
        bus = await stack.enter_async_context(joined(endpoint, playbook.bus.keys, insecure=playbook.bus.insecure))
        folder.write_json(BUS_FILE, msgspec.to_builtins(BusAddress(endpoint, playbook.name, playbook.bus.insecure)))
        tlogs = await stack.enter_async_context(open_tlogs(folder.path / "tlogs", clock))
        counted = CountingLogs(tlogs)
        refused = RefusedOnBus(clock, partial(status.say, level="warning"))
        refused.attach(bus, playbook.name)
        status.refused_on_bus = refused.alert
        desk = _nodes(playbook, folder, bus, clock, status)
        fleet = await stack.enter_async_context(open_links(playbook, clock, sitl, counted, shares_of(desk)))
        taps = await stack.enter_async_context(tapped(playbook, fleet.vehicles, clock))
        status.recording = lambda: tlogs.problem
        status.links = lambda: fleet.statuses(clock.now_s())
        for vehicle in fleet.vehicles.values():
            vehicle.on_notice.append(status.say)
        if playbook.vehicles is None:
            status.phase = "starting the vehicles"
            ports = {name: tap.port for name, tap in taps.items()}
            await start_vehicles(playbook, fleet.vehicles, group, sim_time, sitl, ports)
        if playbook.sensor.is_simulated(vehicles_named=playbook.vehicles is not None):
            await start_sensors(playbook, playbook.seed, group, endpoint, sim_time)
        simulation = Simulation(group, bus, SwarmKeys(playbook.name), taps, sim_time.speedup)
        run = _run(playbook, plan, options, clock, bus, folder, journal, status, fleet, simulation)
        run.takeovers = Takeovers(counted.setpoints)
        run.elsewhere = {name: share.stream for name, share in shares_of(desk).items()}
        await stack.enter_async_context(_recorded(run, token))
        await stack.enter_async_context(_served(run, desk))
        await _staged(run, resumption)
        by_nodes = {} if desk is None else desk.refusals()
        report = run.report() | {"refused_on_bus": refused.report(), "refused_by_nodes": by_nodes}
    figure = folder.path / "figure.svg"
    return RunResult(report, folder, figure, tuple(_unwritten(playbook, run, report, figure)))


def _unwritten(playbook: Playbook, run: Run, report: dict[str, Any], figure: Path) -> Iterator[str]:
    """Write what a run leaves behind; yield what of it cannot be written, and why: it has been flown all the same."""
    folder, places = run.folder, {name: transmitter.at for name, transmitter in playbook.transmitters.items()}
    steps: list[Callable[[], object]] = [
        lambda: folder.write_json("report.json", report),
        lambda: draw_plan(run.plan, places, figure, tracks=run.score.tracks, title=playbook.name),
        lambda: write_report(folder.path),
        lambda: write_junit(folder.path / "junit.xml", [suite_of(playbook.name, report, folder.path)]),
    ]
    for step in steps:
        try:
            step()
        except (ServiceError, OSError) as error:
            yield str(error)


def _on_target(playbook: Playbook, options: RunOptions) -> tuple[Playbook, Sitl | None]:
    """Return the playbook as it is flown, and the simulator that flies it, if one does.

    ServiceError when it cannot be flown so, SimulationError when the user has no such simulator.
    """
    if options.sitl is not None and (playbook.vehicles is not None or options.speedup != 1.0):
        raise ServiceError("--sitl starts the vehicles itself, in real time: leave out 'vehicles' and --speedup")
    playbook = aimed(playbook, options.sitl)
    if options.speedup != 1.0 and playbook.target != "embedded":
        raise ServiceError(f"--speedup is for embedded copters only: this playbook is flown on {playbook.target}")
    if options.seed is not None:
        playbook = playbook.model_copy(update={"seed": options.seed})
    playbook = patient(playbook, options.speedup)
    sitl = SITLS.get(playbook.target or "")
    if sitl is not None:
        sitl.find()
    return playbook, sitl


def _run(
    playbook: Playbook,
    plan: RelayPlan,
    options: RunOptions,
    clock: Clock,
    bus: Bus,
    folder: RunFolder,
    journal: Journal,
    status: RunStatus,
    fleet: FleetLinks,
    simulation: Simulation,
) -> Run:
    """Return the run, in which nothing has been done yet; everybody's words and bearings are taken from now on."""
    keys, frame, board = SwarmKeys(playbook.name), playbook.site.frame, PositionBoard()
    clocks = ClockOffsets(playbook.receivers, clock, status.say)
    clocks.attach(bus, keys)
    gap_s = RelaySettings.of(playbook.flight, playbook.planner.min_separation_m).gap_s
    feed = BearingFeed(playbook.receivers, frame, clock, gap_s, clocks, playbook.sensor.reference)
    feed.attach(bus, keys)
    records = {route.receiver: ReceiverRecord(route) for route in plan.routes}
    status.records = records
    run = Run(
        playbook=playbook,
        plan=plan,
        values=options.values,
        clock=clock,
        bus=bus,
        folder=folder,
        journal=journal,
        status=status,
        fleet=fleet,
        board=board,
        clocks=clocks,
        feed=feed,
        emission=EmissionControl(bus, keys, clock),
        records=records,
        score=Score(frame, board, records),
        operator=Operator(status.say, options.attended, options.terminal, show=status.ask),
        simulation=simulation,
    )
    _publish_positions(run)
    return run


async def _staged(run: Run, resumption: Resumption | None) -> None:
    """Run the stages, or those that are left; what goes wrong beside them is said, and ends them."""
    async with (
        _failures_said(run.status),
        background(run.clocks.run(), run.emission.run()),
        open_background() as run.start,
    ):
        with stopping_on_interrupt(run.operator):
            stages = run.playbook.flow if resumption is None else await resumption.begin(run)
            await run_stages(run, stages)
    run.status.phase = run.outcome


@contextlib.asynccontextmanager
async def _recorded(run: Run, token: Token | None) -> AsyncIterator[None]:
    """Record what is said on the bus and measured, show it, and answer the operator, while the block lasts."""
    with open_lines(run.folder.path / "series.jsonl", synced=False, say=run.status.say) as lines:
        series = Series(lines, run.status, run.board, run.playbook.site.frame, run.clock)
        series.attach(run.bus, run.keys)
        async with (
            open_recording(run.folder.path, run.bus, run.keys, run.clock, run.status.say) as recording,
            background(series.record()),
        ):
            run.trace = recording.note_monitor
            run.bus.serve(run.keys.control, ControlGuard(run.keys.swarm, _answering(run, recording), token).take)
            async with watched(run, recording):
                yield


def _nodes(playbook: Playbook, folder: RunFolder, bus: LiveBus, clock: Clock, status: RunStatus) -> NodeDesk | None:
    """Return the desk for the link nodes of a playbook; None where it names none."""
    if not playbook.nodes:
        return None
    return desk_of(playbook, folder.path, bus, clock, time.time_ns() // 1_000_000, status.say)


@contextlib.asynccontextmanager
async def _served(run: Run, desk: NodeDesk | None) -> AsyncIterator[None]:
    """Serve the link nodes of a run while the block lasts; they have their vehicles when it begins.

    The relay holds when one is lost, and the operator is told what his consent takes.
    """
    if desk is None:
        yield
        return

    def lost(node: str, vehicles: list[str], reason: str) -> None:
        named = ", ".join(vehicles) or "nobody"
        told = f"link node {node} is lost: {reason}; its vehicles stop: {named}"
        run.status.say(told, level="alert")
        if vehicles:
            run.tell(f"to have them taken over: bearing-relay control takeover {node}")
        if run.relay is not None and not run.relay.ended and vehicles:
            run.relay.lose_reach(node, vehicles, reason)

    def back(vehicles: list[str]) -> None:
        if run.relay is not None:
            run.relay.regain_reach(vehicles)

    desk.on_lost.append(lost)
    desk.on_back.append(back)
    desk.withheld = lambda: frozenset() if run.relay is None else run.relay.taken
    run.operator.take_over = desk.take_over
    run.status.phase = "waiting for the link nodes"
    desk.attach()
    problem: ServiceError | None = None
    async with background(desk.run()):
        try:
            await desk.begin()
        except ServiceError as error:
            problem = error  # raised outside the block, by itself
        else:
            yield
    if problem is not None:
        raise problem


def _answering(run: Run, recording: Recording) -> Callable[[bytes], bytes]:
    def answer(payload: bytes) -> bytes:
        reply = run.operator.answer(payload)
        recording.note_control(run.keys, payload, reply)
        return reply

    return answer


@contextlib.asynccontextmanager
async def _failures_said(status: RunStatus) -> AsyncIterator[None]:
    """Put what goes wrong with a vehicle in the block before the operator; the run goes on to its report."""
    try:
        yield
    except* DriverError as failures:
        for failure in leaves(failures):
            status.say(str(failure))


def _publish_positions(run: Run) -> None:
    """Put every vehicle's position on the board and the bus from now on: for safety, screens, score and simulation."""
    site = SiteFrame(run.playbook.site.origin)

    def publisher(name: str) -> Callable[[Kinematics], None]:
        def publish(kinematics: Kinematics) -> None:
            north_east, down_m = site.from_geodetic(kinematics.position)
            north_mps, east_mps, _ = kinematics.velocity_ned_mps
            way = braking_way(complex(north_mps, east_mps))
            run.board.latest[name] = SitePosition(kinematics.time_s, north_east, -down_m, way)
            run.score.moved(name)
            place = (north_east.real, north_east.imag, down_m)
            report = PositionReport(run.clock.unix_ns(), *place, north_mps, east_mps, kinematics.heading_rad)
            run.bus.put_latest(run.keys.position(name), encode(report))

        return publish

    for name, vehicle in run.fleet.vehicles.items():
        vehicle.on_kinematics.append(publisher(name))
