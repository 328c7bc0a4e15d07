"""`inject`: a fault of the simulation, armed now and striking at its moment, while the run goes on."""

from __future__ import annotations

import asyncio
from typing import Final

from drivers.errors import SimulationError
from gcs.errors import ServiceError
from gcs.playbook.stages import Inject, When
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run
from gcs.stages.simulation import End

ENDS_WITH_THE_STAGES: Final = frozenset({"disk_full"})
"""These befall the service itself, which outlasts the run."""
_LOOK_S: Final = 0.05
_KNOWN: Final = (ServiceError, SimulationError)


async def do(run: Run, stage: Inject) -> None:
    """Arm the fault."""
    run.tell(f"armed: {_described(stage)}")
    run.start(_strike(run, stage))


async def _strike(run: Run, stage: Inject) -> None:
    """Let the fault happen when its moment has come, and end it again where it does not last."""
    if stage.at is None:
        await run.clock.sleep(stage.after_s or 0.0)
    else:
        await _moment(run, stage.at)
    try:
        end = await run.simulation.strike(stage)
        run.tell(f"injected: {_named(stage)}")
    except _KNOWN as error:
        run.tell(f"not injected: {_named(stage)}: {error}")
        return
    if stage.for_s is not None or stage.fault in ENDS_WITH_THE_STAGES:
        await _end(run, stage, end)


async def _end(run: Run, stage: Inject, end: End) -> None:
    """End a fault when its time is over, or with the stages when it would outlast them."""
    try:
        await (asyncio.Event().wait() if stage.for_s is None else run.clock.sleep(stage.for_s))
    except asyncio.CancelledError:
        if stage.fault in ENDS_WITH_THE_STAGES:
            await end()
        raise
    try:
        await end()
        run.tell(f"over: {_named(stage)}")
    except _KNOWN as error:
        run.tell(f"not over: {_named(stage)}: {error}")


async def _moment(run: Run, at: When) -> None:
    """Return so long after a receiver first entered a state."""
    while (record := run.records.get(at.receiver)) is None or record.state.value != at.state:
        await run.clock.sleep(_LOOK_S)
    await run.clock.sleep(at.after_s)


def _named(stage: Inject) -> str:
    return f"{stage.fault} {stage.vehicle}" if stage.vehicle else stage.fault


def _described(stage: Inject) -> str:
    at = stage.at
    when = (
        f"{stage.after_s or 0.0:g} s from now" if at is None else f"{at.after_s:g} s after {at.receiver} is {at.state}"
    )
    return f"{_named(stage)} {when}" + (f", for {stage.for_s:g} s" if stage.for_s is not None else "")


def foresee(_outlook: Outlook, stage: Inject) -> Foreseen:
    """Return what would be done."""
    return Foreseen(f"a fault is armed: {_described(stage)}", 0.0)
