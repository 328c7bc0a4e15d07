"""Trials: the runs of several playbooks, flown one after another, each judged by what its playbook expects."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from drivers.clock import SystemClock
from drivers.errors import DriverError
from gcs.errors import ServiceError, leaves
from gcs.expectations import Suite, suite_of
from gcs.playbook.loader import PlaybookError, load_runs
from gcs.playbook.matrix import MatrixRun
from gcs.playbook.schema import Playbook, Target
from gcs.playbook.target import aimed
from gcs.service import RunOptions, Show, fly
from planner.errors import PlannerError
from planner.plan import RelayPlan

SUFFIXES: Final = (".yaml", ".yml")


@dataclass(frozen=True)
class Trial:
    """One run to be flown, of the playbook in a file; or why there is none."""

    path: Path
    run: MatrixRun | None
    problem: str = ""
    skipped: str = ""

    @property
    def name(self) -> str:
        """What it is called: the playbook, and what this run of it changes."""
        if self.run is None:
            return self.path.stem
        return f"{self.run.playbook.name} {self.run.label}".strip()


def find_playbooks(paths: Sequence[Path]) -> list[Path]:
    """Return every playbook among files, and in folders and theirs, in order of their names.

    ServiceError for a path where there is none.
    """
    found: list[Path] = []
    for path in paths:
        files = sorted(file for file in path.rglob("*") if file.suffix in SUFFIXES) if path.is_dir() else [path]
        if not files:
            raise ServiceError(f"{path} holds no playbook: they end in {' or '.join(SUFFIXES)}")
        found += files
    return list(dict.fromkeys(found))


def trials(paths: Sequence[Path], target: Target | None, *, slow: bool, only: str = "") -> list[Trial]:
    """Return the runs of the playbooks, as they are flown on a target; `only` those with this in name or path.

    One that cannot be read or flown there says so. Slow ones are skipped unless wanted, and real vehicles are flown
    only where the target says it. ServiceError when nothing is left.
    """
    found = [trial for path in find_playbooks(paths) for trial in _of_file(path, target, slow=slow)]
    left = [trial for trial in found if only.casefold() in f"{trial.path} {trial.name}".casefold()]
    if not left:
        raise ServiceError(f"no run is called anything like {only!r}: there are {', '.join(t.name for t in found)}")
    return left


def _of_file(path: Path, target: Target | None, *, slow: bool) -> Iterator[Trial]:
    try:
        runs = [replace(run, playbook=aimed(run.playbook, target)) for run in load_runs(path)]
    except PlaybookError as error:
        yield Trial(path, None, problem=str(error))
        return
    except ServiceError as error:
        yield Trial(path, None, problem=f"{path}: {error}")
        return
    for run in runs:
        yield Trial(path, run, skipped=_skipped(run.playbook, target, slow=slow))


def _skipped(playbook: Playbook, target: Target | None, *, slow: bool) -> str:
    if playbook.slow and not slow:
        return "it is slow: only with --slow"
    if playbook.target == "vehicles" and target != "vehicles":
        return "it flies real vehicles: only with --target vehicles, or simulated with --target embedded"
    return ""


def fly_trial(trial: Trial, runs_dir: Path, speedup: float, show: Show) -> Suite:
    """Fly one trial and return what became of it. Only embedded copters are sped up."""
    if trial.run is None or trial.skipped:
        return Suite(trial.name, 0.0, error=trial.problem, skipped=trial.skipped)
    clock = SystemClock()
    began_s = clock.now_s()
    try:
        result = asyncio.run(fly(*_flight(trial.run, runs_dir, speedup), show))
    except (ServiceError, DriverError, PlannerError, ExceptionGroup) as error:
        reasons = list(leaves(error))
        if not all(isinstance(reason, ServiceError | DriverError | PlannerError) for reason in reasons):
            raise
        return Suite(trial.name, clock.now_s() - began_s, error="; ".join(map(str, reasons)))
    if result.unwritten:
        return Suite(trial.name, clock.now_s() - began_s, error="; ".join(result.unwritten))
    return suite_of(trial.name, result.report, result.folder.path, clock.now_s() - began_s)


def _flight(run: MatrixRun, runs_dir: Path, speedup: float) -> tuple[Playbook, RelayPlan, RunOptions]:
    playbook = run.playbook
    options = RunOptions(runs_dir, speedup if playbook.target == "embedded" else 1.0, values=run.values)
    return playbook, playbook.plan(), options
