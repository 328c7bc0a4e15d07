"""`land`: every vehicle lands where it is."""

from __future__ import annotations

from gcs.playbook.stages import Land
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run, StageError
from gcs.stages.together import all_of


async def do(run: Run, _stage: Land) -> None:
    """Land all at once and wait until each has disarmed. A pilot's vehicle is left alone: StageError then."""
    pilots = run.pilots()
    await all_of(run.autopilots[name].land(run.fleet.vehicles[name]) for name in list(run.flying()))
    if pilots:
        raise StageError(f"{', '.join(pilots)} is its pilot's and was not landed")


def foresee(outlook: Outlook, _stage: Land) -> Foreseen:
    """Return what would be done."""
    return Foreseen("every vehicle lands where it is", outlook.descent_s)
