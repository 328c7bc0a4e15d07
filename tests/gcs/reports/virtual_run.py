"""A run's folder as the service leaves it, flown by the real executor in virtual time: seconds instead of minutes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from drivers.bus.messages import PositionReport, Progress, encode
from gcs.recording.facts import RunFacts
from gcs.recording.flight import open_recording
from gcs.recording.journal import open_journal
from gcs.recording.lines import open_lines
from gcs.recording.run_folder import RunFolder
from gcs.recording.score import Score
from gcs.recording.series import Series
from gcs.recording.versions import versions
from gcs.relay.records import ReceiverRecord
from gcs.reports.run_report import RunFigures, run_report
from gcs.safety import PositionBoard, SitePosition
from gcs.status import RunStatus
from planner.plan import plan_to_json
from tests.gcs.relay.world import World

SPOKEN = ("every_bearings", "every_position", "every_emission", "progress")
NOON = datetime(2026, 11, 22, 12, 0, 0, tzinfo=UTC)

Meanwhile = Callable[[World, float], None]


class _ToldWorld(World):
    """A world that tells of every change of a receiver."""

    tell: Callable[[ReceiverRecord], None] = staticmethod(lambda record: None)

    def _announce(self, record: ReceiverRecord) -> None:
        super()._announce(record)
        self.tell(record)


class _Everything:
    """The world's bus for a subscriber of everything."""

    def __init__(self, world: World) -> None:
        self._world = world

    def subscribe(self, key_expression: str, handler: Callable[[str, bytes], None]) -> None:
        for name in SPOKEN:
            self._world.bus.subscribe(getattr(self._world.keys, name), handler)


def fly(runs_dir: Path, meanwhile: Meanwhile = lambda world, time_s: None, uavs: int = 8, seed: int = 1) -> Path:
    """Fly the paper's UAVs and return the folder, everything but report.html in it."""
    return asyncio.run(_fly(runs_dir, meanwhile, uavs, seed))


async def _fly(runs_dir: Path, meanwhile: Meanwhile, uavs: int, seed: int) -> Path:
    world, board = _ToldWorld(seed=seed, uavs=uavs), PositionBoard()
    folder = RunFolder.create(runs_dir, world.playbook.name, NOON)
    folder.write_json("playbook.json", world.playbook.model_dump(mode="json"))
    folder.write_json("plan.json", plan_to_json(world.plan))
    facts = RunFacts(world.clock.unix_ns(), speedup=1.0, seed=seed, sitl=None, versions=versions())
    folder.write_json("run.json", msgspec.to_builtins(facts))
    status = RunStatus(world.playbook.name, world.clock, records=world.executor.records)
    score = Score(world.frame, board, world.executor.records)
    with (
        open_journal(folder.path / "journal.jsonl") as journal,
        open_lines(folder.path / "series.jsonl", synced=False) as lines,
    ):
        series = Series(lines, status, board, world.frame, world.clock)
        series.attach(world.bus, world.keys)

        def announce(record: ReceiverRecord) -> None:
            now_ns = world.clock.unix_ns()
            entry = {"receiver": record.name, "slot": record.route.slot, "state": record.state.value}
            journal.append({"time_ns": now_ns, **entry, "reason": record.reason})
            progress = Progress(now_ns, record.name, record.state.value, record.reason)
            world.bus.put_reliably(world.keys.progress, encode(progress))

        world.tell = announce

        def step(time_s: float) -> None:
            for name, vehicle in world.vehicles.items():
                at = vehicle.place
                board.latest[name] = SitePosition(world.clock.now_s(), at, 20.0)
                score.moved(name)
                report = PositionReport(world.clock.unix_ns(), at.real, at.imag, -20.0, 0.0, 0.0)
                world.bus.put_latest(world.keys.position(name), encode(report))
            meanwhile(world, time_s)

        async with open_recording(folder.path, _Everything(world), world.keys, world.clock, status.say):
            recording = asyncio.create_task(series.record())
            await world.run(meanwhile=step)
            series.sample()
            recording.cancel()
    outcome = "formed" if world.executor.formed else "aborted"
    figures = RunFigures(
        world.playbook.name, outcome, status.elapsed_s(), world.emission.transmitter_s(), world.feed.counters
    )
    folder.write_json("report.json", run_report(figures, world.plan, world.executor.records, score))
    return folder.path
