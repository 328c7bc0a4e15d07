"""`hold`: every vehicle holds its place for a time."""

from __future__ import annotations

from gcs.playbook.stages import Hold
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run


async def do(run: Run, stage: Hold) -> None:
    """Command zero velocity once more, and let time pass."""
    for member in run.members.values():
        member.stream.stop()
    await run.clock.sleep(stage.for_s)


def foresee(_outlook: Outlook, stage: Hold) -> Foreseen:
    """Return what would be done."""
    return Foreseen("every vehicle holds its place", stage.for_s)
