"""`preflight`: check every vehicle, and clear the fleet to be armed."""

from __future__ import annotations

from gcs.fleet import cleared_to_arm
from gcs.playbook.stages import Preflight
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run


async def do(run: Run, _stage: Preflight) -> None:
    """Check the whole fleet; PreflightError when something is wrong that nothing may be armed with."""
    run.autopilots = await cleared_to_arm(run.playbook, run.plan, run.fleet.vehicles, run.status.say)


def foresee(outlook: Outlook, _stage: Preflight) -> Foreseen:
    """Return what would be done."""
    return Foreseen(f"every vehicle is checked, {len(outlook.playbook.uavs)} in all; nothing is armed", 6.0)
