"""Runs the stages of a run one after another; however one ends, every vehicle that moves is told to stop first."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Final

from msgspec.structs import replace

from drivers.errors import DriverError
from gcs.errors import ServiceError, leaves
from gcs.expectations import judge
from gcs.playbook.stage_rules import NamedStage
from gcs.playbook.stages import Land, RetriedStage, Return
from gcs.stages.registry import STAGES
from gcs.stages.run import FOR_THE_PLAYBOOK, Run, StageOutcome, StageResult
from planner.errors import PlannerError

ENDING_S: Final = 10.0
"""How long a stage that is told to end may take to end in its own order."""

KNOWN: Final = (DriverError, ServiceError, PlannerError)
"""What a stage fails of; anything else is a mistake in the program, and ends the run."""

_CUT_SHORT: Final[tuple[StageOutcome, str]] = ("stopped", "cut short")

PHASES: Final = {"takeoff": "taking off", "land": "landing", "return": "returning", "measure": "measuring"}
"""What screens call a stage that is under way, where that is not its word."""


async def run_stages(run: Run, stages: Sequence[NamedStage]) -> None:
    """Run them; what became of each is noted in the run, with the verdicts on what was expected after it.

    What was expected after a stage that is not reached does not come true. Nobody is kept on the air afterwards.
    """
    left = list(stages)
    try:
        while left:
            stage = left.pop(0)
            result = await _run(run, stage)
            if result.outcome != "done" and not await _goes_on(run, stage):
                break
    finally:
        run.emission.need(FOR_THE_PLAYBOOK, ())
        run.results += [StageResult(stage.name, stage.kind, "not_reached") for stage in left]
        for stage in left:
            verdicts = judge(stage.settings.expect, {}, stage.name)
            run.verdicts += [replace(verdict, measured=None, passed=False) for verdict in verdicts]
        run.verdicts += judge(run.playbook.expect, run.report())


async def _run(run: Run, stage: NamedStage) -> StageResult:
    """Run one stage, again where it may be tried again, and note what became of it."""
    began_s, run.stage = run.status.elapsed_s(), stage.name
    run.status.phase = PHASES.get(stage.kind, stage.kind)
    _note(run, stage, "begun")
    outcome, reason = _CUT_SHORT
    try:
        outcome, reason = await _tried(run, stage)
    finally:
        result = StageResult(stage.name, stage.kind, outcome, began_s, run.status.elapsed_s(), reason)
        run.results.append(result)
        _note(run, stage, outcome, reason)
        _judge(run, stage)
    return result


async def _tried(run: Run, stage: NamedStage) -> tuple[StageOutcome, str]:
    """Attempt a stage, again where it may be tried again; return what became of it, and why."""
    retries = stage.settings.retries if isinstance(stage.settings, RetriedStage) else 0
    outcome, reason = await _attempt(run, stage)
    while outcome == "failed" and retries > 0:
        run.tell(f"{stage.name} failed and is tried again: {reason}")
        retries -= 1
        outcome, reason = await _attempt(run, stage)
    if outcome == "failed":
        run.status.say(reason)
    return outcome, reason


async def _attempt(run: Run, stage: NamedStage) -> tuple[StageOutcome, str]:
    """Run a stage until it ends, its time is over or the run is stopped; return what became of it, and why."""
    if run.operator.stopped is not None:
        return "stopped", run.operator.stopped
    doing = asyncio.ensure_future(STAGES[stage.kind].do(run, stage.settings))
    stopping = asyncio.ensure_future(run.operator.until_stopped())
    timeout_s = stage.settings.timeout_s
    timer = None if timeout_s is None else asyncio.ensure_future(run.clock.sleep(timeout_s))
    overdue = ""
    try:
        await asyncio.wait(filter(None, (doing, stopping, timer)), return_when=asyncio.FIRST_COMPLETED)
        if not doing.done():
            overdue = "" if stopping.done() else f"{stage.name} took longer than {timeout_s:g} s"
            await _end(run, doing, run.operator.stopped or overdue)
    finally:
        for task in filter(None, (doing, stopping, timer)):
            task.cancel()
        await asyncio.wait((doing,))
        run.stop_all()
    failure = None if doing.cancelled() else doing.exception()
    if failure is not None and (unknown := [leaf for leaf in leaves(failure) if not isinstance(leaf, KNOWN)]):
        raise unknown[0]
    if run.operator.stopped is not None:
        return "stopped", run.operator.stopped
    if failure is None and not overdue:
        return "done", ""
    return "failed", overdue or "\n".join(map(str, leaves(failure) if failure is not None else ()))


async def _end(run: Run, doing: asyncio.Future[None], reason: str) -> None:
    """Stop every vehicle, and have the stage end: in its own order, or cut short when that takes too long."""
    run.stop_all()
    if run.halt is None:
        doing.cancel()
    else:
        run.halt(reason)
    patience = asyncio.ensure_future(run.clock.sleep(ENDING_S))
    try:
        await asyncio.wait((doing, patience), return_when=asyncio.FIRST_COMPLETED)
    finally:
        patience.cancel()
        doing.cancel()
        await asyncio.wait((doing,))


async def _goes_on(run: Run, stage: NamedStage) -> bool:
    """Do what is to be done when a stage has failed; return whether the next one is run."""
    if run.operator.stopped is not None:
        return False
    wanted = stage.settings.on_failure
    if wanted == "skip":
        run.tell(f"{stage.name} failed: the next stage is run all the same")
        return True
    if wanted == "hold" and run.operator.attended:
        going_on = await _asked(run, f"{stage.name} failed, every vehicle holds; go on with the next stage?")
        return going_on and run.operator.stopped is None
    if wanted in ("return", "land") and any(True for _ in run.flying()):
        run.tell(f"{stage.name} failed: {wanted}")
        settings = Return() if wanted == "return" else Land()
        await _run(run, NamedStage(f"{stage.name}-{wanted}", wanted, settings))
    return False


async def _asked(run: Run, question: str) -> bool:
    """Ask the operator; a run that is stopped meanwhile does not go on."""
    asking = asyncio.ensure_future(run.operator.goes_on(question))
    stopping = asyncio.ensure_future(run.operator.until_stopped())
    try:
        await asyncio.wait((asking, stopping), return_when=asyncio.FIRST_COMPLETED)
        return asking.done() and asking.result()
    finally:
        asking.cancel()
        stopping.cancel()


def _judge(run: Run, stage: NamedStage) -> None:
    if stage.settings.expect:
        run.verdicts += judge(stage.settings.expect, run.report(), stage.name)


def _note(run: Run, stage: NamedStage, state: str, reason: str = "") -> None:
    """Put into the journal what becomes of a stage, where a playbook names its stages."""
    if run.playbook.stages is not None:
        entry = {"stage": stage.name, "kind": stage.kind, "state": state, "reason": reason}
        run.journal.append({"time_ns": run.clock.unix_ns(), **entry})
