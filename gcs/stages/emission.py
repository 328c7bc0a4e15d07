"""`emission`: transmitters kept on, or no longer kept on. What the relay needs is on in any case."""

from __future__ import annotations

from gcs.playbook.stages import EmissionStage
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import FOR_THE_PLAYBOOK, Run


async def do(run: Run, stage: EmissionStage) -> None:
    """Switch them, and say who is on the air then."""
    run.kept_on = (run.kept_on | set(stage.on)) - set(stage.off)
    run.emission.need(FOR_THE_PLAYBOOK, run.kept_on)
    run.status.on_air = run.emission.on_air
    run.tell(f"on the air: {', '.join(sorted(run.emission.on_air)) or 'nobody'}")


def foresee(outlook: Outlook, stage: EmissionStage) -> Foreseen:
    """Return what would be done, and keep in mind who is kept on."""
    outlook.kept_on.update(stage.on)
    outlook.kept_on.difference_update(stage.off)
    kept = f"kept on the air: {', '.join(sorted(outlook.kept_on)) or 'nobody'}"
    return Foreseen(f"{kept}; besides, whom the relay needs", 0.0)
