"""`connect`: hear every vehicle."""

from __future__ import annotations

from drivers.mavlink.vehicle import Vehicle
from gcs.playbook.stages import Connect
from gcs.preflight.facts import HEARTBEAT_TIMEOUT_S
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run
from gcs.stages.together import all_of


async def do(run: Run, _stage: Connect) -> None:
    """Return when every vehicle has been heard. VehicleError for each that is not, in a group."""
    await all_of(_heard(vehicle) for vehicle in run.fleet.vehicles.values())


async def _heard(vehicle: Vehicle) -> None:
    await vehicle.wait_until(
        lambda: vehicle.telemetry.heartbeat is not None,
        HEARTBEAT_TIMEOUT_S,
        f"heartbeat of system id {vehicle.system_id}",
        "Check the link's address and system id, and that the autopilot runs.",
    )


def foresee(outlook: Outlook, _stage: Connect) -> Foreseen:
    """Return what would be done."""
    return Foreseen(f"a heartbeat of each vehicle is waited for, {len(outlook.playbook.uavs)} in all", 3.0)
