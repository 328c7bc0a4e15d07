"""`prompt`: the operator's word to go on."""

from __future__ import annotations

from gcs.control import STOPPED
from gcs.playbook.stages import Prompt
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run, StageError


async def do(run: Run, stage: Prompt) -> None:
    """Wait for his word, as long as he likes. StageError when nobody attends."""
    if not run.operator.attended:
        raise StageError(f"nobody is there to be asked {stage.text!r}: fly it with --attended, or leave the prompt out")
    if not await run.operator.goes_on(stage.text):
        run.operator.stop(STOPPED)
        raise StageError("the operator did not go on")


def foresee(_outlook: Outlook, stage: Prompt) -> Foreseen:
    """Return what would be done."""
    return Foreseen(f"the operator is asked: {stage.text}", None)
