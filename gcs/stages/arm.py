"""`arm`: arm every vehicle on the ground, each once."""

from __future__ import annotations

from gcs.playbook.stages import Arm
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run


async def do(run: Run, _stage: Arm) -> None:
    """Arm one vehicle after another; those in the air are left alone. VehicleError for the first that refuses."""
    run.require_cleared()
    for name, vehicle in run.fleet.vehicles.items():
        autopilot = run.autopilots[name]
        if vehicle.armed:
            continue
        await autopilot.arm(vehicle)
        run.tell(f"{name} is armed")


def foresee(outlook: Outlook, _stage: Arm) -> Foreseen:
    """Return what would be done."""
    return Foreseen(f"armed one after another: {', '.join(outlook.playbook.uavs)}", len(outlook.playbook.uavs))
