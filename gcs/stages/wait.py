"""`wait`: let time pass."""

from __future__ import annotations

from gcs.playbook.stages import Wait
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run


async def do(run: Run, stage: Wait) -> None:
    """Do nothing for a while."""
    await run.clock.sleep(stage.for_s)


def foresee(_outlook: Outlook, stage: Wait) -> Foreseen:
    """Return what would be done."""
    return Foreseen("time passes", stage.for_s)
