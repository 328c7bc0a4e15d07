"""`takeoff`: bring every vehicle into guided flight."""

from __future__ import annotations

from gcs.fleet import bring_up
from gcs.playbook.stages import Takeoff
from gcs.stages.outlook import CLIMB_MPS, Foreseen, Outlook
from gcs.stages.run import Run


async def do(run: Run, _stage: Takeoff) -> None:
    """Bring all up at once. VehicleError, in a group, naming those that refuse; the others then hold where they are."""
    run.require_cleared()
    try:
        await bring_up(
            *(run.playbook, run.fleet.vehicles, run.autopilots, run.clock, run.start, run.members, run.elsewhere)
        )
        for name, member in run.members.items():
            if name in run.elsewhere:
                run.takeovers.ask(name, run.elsewhere[name].setpoints_after)
            else:
                run.takeovers.watch(member.vehicle, member.autopilot.is_guided)
    except BaseException:
        for name in [name for name in run.flying() if name not in run.members]:
            run.brake(name)
        raise


def foresee(outlook: Outlook, _stage: Takeoff) -> Foreseen:
    """Return what would be done."""
    altitude_m = outlook.playbook.flight.altitude_m
    return Foreseen(f"up to {altitude_m:g} m: {', '.join(outlook.playbook.uavs)}", 4.0 + altitude_m / CLIMB_MPS)
