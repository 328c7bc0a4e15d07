"""A run's folder as the service leaves it, flown by the real relay in virtual time, with flight.mcap."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec

from drivers.bus.messages import Progress, encode
from gcs.playbook.schema import Playbook
from gcs.recording.facts import RunFacts
from gcs.recording.flight import Recording
from gcs.recording.mcap_file import McapFiles, SizeLimits
from gcs.recording.run_folder import RunFolder
from gcs.relay.records import ReceiverRecord
from gcs.simulate.bus import LocalBus
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from gcs.simulate.world import RelayWorld
from gcs.traced_monitor import MonitorNote
from planner.plan import plan_to_json

EVERYTHING = ("every_bearings", "every_emission", "progress", "every_clock_ping", "every_clock_pong")
IN_MEMORY = 1_000_000

Prepare = Callable[[RelayWorld], None]


class RecordedWorld(RelayWorld):
    """A world whose relay is recorded as the service records one."""

    recording: Recording

    def record(self, folder: Path, limits: SizeLimits) -> None:
        files = McapFiles(folder, {"swarm": self.keys.swarm}, limits, free_bytes=lambda _: 10**12)
        self.recording = Recording(files, self.clock, self.said.append, queue_length=IN_MEMORY)
        for name in EVERYTHING:
            self.bus.subscribe(getattr(self.keys, name), self.recording.note)

    def announced(self, record: ReceiverRecord) -> None:
        progress = Progress(self.clock.unix_ns(), record.name, record.state.value, record.reason)
        self.bus.put_history(self.keys.progress, encode(progress))

    def traced(self, receiver: str, note: MonitorNote) -> None:
        self.recording.note_monitor(receiver, note)


def record(
    folder: Path,
    playbook: Playbook,
    seed: int = 1,
    prepare: Prepare = lambda world: None,
    limits: SizeLimits | None = None,
) -> Path:
    """Fly a playbook and return the run's folder."""
    run, plan = RunFolder.create(folder, playbook.name), playbook.plan()
    run.write_json("playbook.json", playbook.model_dump(mode="json"))
    run.write_json("plan.json", plan_to_json(plan))

    async def fly() -> None:
        clock = VirtualClock()
        run.write_json("run.json", msgspec.to_builtins(RunFacts(clock.unix_ns(), 1.0, seed, None, {})))
        world = RecordedWorld(playbook, plan, clock, LocalBus(), seed=seed)
        world.record(run.path, limits or SizeLimits())
        prepare(world)
        await world.run(600.0)
        world.recording.end()
        world.recording.write_all(world.said.append)

    run_virtually(fly())
    return run.path
