"""A campaign: many relays flown with drawn faults, on all processors, and what was found in them, counted by fault."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Final

import msgspec

from gcs.errors import ServiceError
from gcs.faults.fault import KINDS
from gcs.faults.findings import INVARIANTS
from gcs.faults.outcome import FaultRun, fly_with_faults
from gcs.playbook.schema import Playbook
from planner.plan import RelayPlan

_CHUNK: Final = 4
_WAITING_PER_WORKER: Final = 2
_HANGS_S: Final = 600.0
"""Nobody flies a few relays in virtual time for so long: one of them turns in circles."""


def fly_campaign(
    playbook: Playbook,
    plan: RelayPlan,
    seeds: Sequence[int],
    pool: Executor,
    workers: int,
    done: Callable[[FaultRun], None],
) -> list[FaultRun]:
    """Fly a relay with the faults of each seed and return the runs by seed; `done` is told each as it comes.

    ServiceError, naming the seeds under way, when none of them comes to an end.
    """
    chunks = iter([seeds[first : first + _CHUNK] for first in range(0, len(seeds), _CHUNK)])
    waiting: dict[Future[list[FaultRun]], Sequence[int]] = {}
    runs: list[FaultRun] = []
    while True:
        for chunk in itertools.islice(chunks, max(0, _WAITING_PER_WORKER * workers - len(waiting))):
            waiting[pool.submit(fly_many, playbook, plan, chunk)] = chunk
        if not waiting:
            return sorted(runs, key=lambda run: run.seed)
        finished, _ = wait(waiting, _HANGS_S, FIRST_COMPLETED)
        if not finished:
            under_way = sorted(itertools.chain.from_iterable(waiting.values()))
            raise ServiceError(f"a run hangs, one of the seeds {', '.join(map(str, under_way))}: fly each by itself")
        for future in finished:
            for run in _result(future, waiting.pop(future)):
                runs.append(run)
                done(run)


def fly_many(playbook: Playbook, plan: RelayPlan, seeds: Sequence[int]) -> list[FaultRun]:
    """Fly one relay for each seed, in this process."""
    return [fly_with_faults(playbook, plan, seed) for seed in seeds]


def _result(future: Future[list[FaultRun]], flown: Sequence[int]) -> list[FaultRun]:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise ServiceError(
            f"a process that flew runs has died, perhaps of one of the seeds {', '.join(map(str, flown))}: "
            "fly each by itself, or fewer --jobs where memory is short"
        ) from error


def summary(playbook: Playbook, first_seed: int, runs: Sequence[FaultRun]) -> dict[str, Any]:
    """Return what a campaign found, as JSON: each violation with the seed that repeats it."""
    found = Counter(finding.invariant for run in runs for finding in run.violations)
    distances_m = [run.closest_m for run in runs if run.closest_m is not None]
    return {
        "playbook": playbook.name,
        "first_seed": first_seed,
        "runs": len(runs),
        "struck": sum(any(at_s is not None for at_s in run.struck_s) for run in runs),
        "outcomes": dict(sorted(Counter(run.outcome for run in runs).items())),
        "violations": list(_violations(runs)),
        "by_invariant": {invariant: found[invariant] for invariant in INVARIANTS},
        "by_fault": {kind: _of_kind(kind, runs) for kind in KINDS},
        "wrong_placements": sum(run.wrong_placements for run in runs),
        "doubted_placements": sum(run.doubted_placements for run in runs),
        "closest_m": min(distances_m, default=None),
    }


def _violations(runs: Sequence[FaultRun]) -> Iterator[dict[str, Any]]:
    for run in runs:
        for finding in run.violations:
            faults = msgspec.to_builtins(run.faults)
            yield {"seed": run.seed, **msgspec.to_builtins(finding), "attended": run.attended, "faults": faults}


def _of_kind(kind: str, runs: Sequence[FaultRun]) -> dict[str, int]:
    """Return what became of the runs in which a fault of this kind struck."""
    struck = [
        run
        for run in runs
        if any(fault.kind == kind and at_s is not None for fault, at_s in zip(run.faults, run.struck_s, strict=True))
    ]
    outcomes = Counter(run.outcome for run in struck)
    return {
        "runs": len(struck),
        "formed": outcomes["formed"],
        "held": outcomes["held"],
        "violations": sum(len(run.violations) for run in struck),
        "wrong_placements": sum(run.wrong_placements for run in struck),
    }
