"""A run before its screens: everything that is told of it is taken from where it is, while a block lasts."""

from __future__ import annotations

import contextlib
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field

from drivers.bus.run_messages import RecordingHealth, RunSetup
from gcs.monitor.decision_times import DecisionTimes
from gcs.monitor.publisher import published
from gcs.monitor.run_setup import run_setup
from gcs.monitor.sources import RunSources
from gcs.monitor.structured_log import structured_log
from gcs.monitor.timing import Pace
from gcs.recording.flight import Recording
from gcs.stages.run import Run
from gcs.traced_monitor import MonitorNote, Trace
from planner.plan import RelayPlan


@dataclass
class _Setups:
    """The setup of a run, made anew for every plan it flies."""

    run: Run
    name: str
    """Of the run in this service: one that resumes it begins anew."""
    started_ns: int
    _of: RelayPlan | None = field(default=None, init=False)
    _made: list[RunSetup] = field(default_factory=list, init=False)

    def latest(self) -> RunSetup:
        """Return the setup for the plan in force."""
        run = self.run
        if run.plan is not self._of:
            setup = run_setup(
                run.playbook,
                run.plan,
                run=self.name,
                started_ns=self.started_ns,
                number=len(self._made),
                attended=run.operator.attended,
                folder=str(run.folder.path.resolve()),
            )
            self._of = run.plan
            self._made.append(setup)
        return self._made[-1]


def _both(first: Trace, second: Trace) -> Trace:
    def take(receiver: str, note: MonitorNote) -> None:
        first(receiver, note)
        second(receiver, note)

    return take


@contextlib.asynccontextmanager
async def watched(run: Run, recording: Recording) -> AsyncIterator[None]:
    """Publish a run to all screens and write its structured log, while the block lasts.

    What its stop monitors tell from now on goes where it went before, and is timed.
    """
    status, decisions = run.status, DecisionTimes(run.clock)
    run.trace = _both(run.trace, decisions.note)
    name = f"{run.folder.path.name}/{time.time_ns()}"
    setups = _Setups(run, name, run.clock.unix_ns() - round(status.elapsed_s() * 1e9))
    sources = RunSources(
        setup=setups.latest(),
        status=status,
        frame=run.playbook.site.frame,
        pace=Pace(run.playbook.flight.speed_mps),
        board=run.board,
        vehicles=run.fleet.vehicles,
        bus_connected=run.bus.connected,
        recording=lambda: RecordingHealth(recording.stopped or "", recording.dropped),
        decisions=decisions.histogram,
        feed=run.feed,
        on_air=lambda: run.emission.on_air,
    )
    sources.plan_setup = setups.latest
    with structured_log(run.folder.logs, status):
        async with published(run.bus, run.keys, sources):
            yield
