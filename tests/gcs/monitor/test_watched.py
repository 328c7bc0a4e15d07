"""A run of the service is put before its screens as it is, anew when it is planned anew, and logged."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from drivers.bus.run_messages import RunEvent, RunSetup, RunState, decode_run
from gcs.monitor.structured_log import FILE
from gcs.monitor.watched import watched
from gcs.recording.run_folder import RunFolder
from gcs.stages.run import Run
from gcs.traced_monitor import Asked, MonitorNote, Observed
from tests.gcs.monitor.telling import ToldWorld, vehicle

OBSERVED = Observed({}, {}, [])
ASKED = Asked((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0.1, arrived=False)


class Watched:
    """A run as the service holds it, of a world in virtual time; and a recording."""

    def __init__(self, folder: Path) -> None:
        self.world = world = ToldWorld()
        self.traced: list[tuple[str, MonitorNote]] = []
        self.recording = SimpleNamespace(stopped=None, dropped=0)
        self.run = SimpleNamespace(
            playbook=world.playbook,
            plan=world.plan,
            folder=RunFolder.create(folder, "paper-8"),
            operator=SimpleNamespace(attended=True),
            status=world.status,
            board=world.score.board,
            fleet=SimpleNamespace(vehicles={"U1": vehicle("U1", world.clock)}),
            bus=world.bus,
            keys=world.keys,
            feed=world.feed,
            emission=world.emission,
            clock=world.clock,
            trace=lambda receiver, note: self.traced.append((receiver, note)),
        )

    def state(self) -> RunState:
        return decode_run(self.world.bus.payloads(self.world.keys.state)[-1], RunState)

    def setups(self) -> list[RunSetup]:
        return [decode_run(payload, RunSetup) for payload in self.world.bus.payloads(self.world.keys.setup)]


@pytest.fixture
def watched_run(tmp_path: Path) -> Watched:
    return Watched(tmp_path)


async def test_a_run_is_told_from_where_it_is(watched_run: Watched) -> None:
    run, world = watched_run.run, watched_run.world
    world.clock.jump(4.0)
    async with watched(run, watched_run.recording):
        watched_run.recording.dropped, watched_run.recording.stopped = 3, "no space left"
        for note in (MonitorNote(0, world.clock.now_s(), observed=OBSERVED), MonitorNote(1, 4.0, asked=ASKED)):
            run.trace("U1", note)
        world.bus.up = False
        world.emission.need("U1", ["L0", "L1"])
        world.status.say("U1 LEG_1", vehicle="U1", leg=1, state="LEG_1")
    state, (setup,) = watched_run.state(), watched_run.setups()
    assert state.run.startswith(f"{run.folder.path.name}/")
    assert (state.recording.dropped, state.recording.problem) == (3, "no space left")
    assert not state.bus.connected
    assert [told.name for told in state.vehicles] == ["U1"]
    assert state.on_air == ["L0", "L1"]
    assert [told.name for told in state.receivers] == list(world.executor.records)
    assert state.decisions.counts[-1] == 1
    assert [note.number for _, note in watched_run.traced] == [0, 1]
    assert (setup.run, setup.attended, setup.folder) == (state.run, True, str(run.folder.path.resolve()))
    assert setup.started_ns == world.clock.unix_ns() - 4_000_000_000
    assert [route.receiver for route in setup.routes] == [route.receiver for route in world.plan.routes]
    (event,) = (decode_run(payload, RunEvent) for payload in world.bus.payloads(world.keys.events))
    assert (event.vehicle, event.state, event.elapsed_s) == ("U1", "LEG_1", 4.0)
    (line,) = (run.folder.logs / FILE).read_text().splitlines()
    assert json.loads(line)["vehicle"] == "U1"


async def test_a_service_that_resumes_a_run_is_told_apart_from_the_one_before(watched_run: Watched) -> None:
    run, world = watched_run.run, watched_run.world
    names = []
    for _ in range(2):
        async with watched(run, watched_run.recording):
            pass
        names.append(watched_run.state().run)
    assert len(set(names)) == 2
    assert len(world.status.on_said) == 0


async def test_a_plan_made_anew_is_another_setup(watched_run: Watched) -> None:
    run, world = watched_run.run, watched_run.world
    async with watched(run, watched_run.recording):
        run.plan = world.playbook.plan(min_separation_m=0.0)
    first, second = watched_run.setups()
    assert (first.number, second.number, watched_run.state().setup) == (0, 1, 1)


def test_everything_that_is_taken_is_there_in_a_run() -> None:
    """The stand-in above has no attribute that a run of the service does not have."""
    names = {
        "playbook",
        "plan",
        "folder",
        "operator",
        "status",
        "board",
        "fleet",
        "bus",
        "feed",
        "emission",
        "clock",
        "trace",
    }
    assert names <= Run.__dataclass_fields__.keys()
    assert isinstance(Run.keys, property)
