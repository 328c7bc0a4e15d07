"""Runs the preflight of a fleet, all vehicles at once."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import replace

from drivers.errors import VehicleError
from drivers.mavlink.checks import Check, Verdict
from drivers.mavlink.vehicle import Vehicle
from gcs.playbook.schema import Playbook
from gcs.preflight.expected import Expected, expectations
from gcs.preflight.facts import VehicleFacts, gather_facts
from gcs.preflight.fleet_checks import check_fleet
from gcs.preflight.report import PreflightReport
from gcs.preflight.vehicle_checks import check_vehicle
from planner.plan import RelayPlan

Show = Callable[[Check], None]
"""Gets every check as it is waited for (RUNNING), and as it comes out."""


async def preflight(
    vehicles: Mapping[str, Vehicle], playbook: Playbook, plan: RelayPlan, show: Show = lambda _check: None
) -> PreflightReport:
    """Check every vehicle, and the fleet; nothing is armed, and no mode or parameter is changed.

    Takes as long as the slowest vehicle needs to know its position, at least a few seconds.
    """
    expected = expectations(playbook, plan)
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(_examined(vehicle, expected[name], show)) for name, vehicle in vehicles.items()]
    checks: list[Check] = []
    fleet: list[VehicleFacts] = []
    for task in tasks:
        facts, found = task.result()
        checks += found
        if facts is not None:
            fleet.append(facts)
    between = list(check_fleet(fleet))
    for check in between:
        show(check)
    return PreflightReport((*checks, *between), {facts.name: facts.autopilot for facts in fleet})


async def _examined(vehicle: Vehicle, expected: Expected, show: Show) -> tuple[VehicleFacts | None, list[Check]]:
    """Return what a vehicle told and its checks; without facts, the one at which it went no further."""
    stage = "heartbeat"

    def progress(name: str, awaited: str) -> None:
        nonlocal stage
        stage = name
        show(Check(vehicle.name, name, Verdict.RUNNING, awaited))

    facts = None
    try:
        facts = await gather_facts(vehicle, expected, progress)
    except VehicleError as error:
        checks = [Check(vehicle.name, stage, Verdict.HARD, error.problem, error.way_out)]
    else:
        checks = list(check_vehicle(facts))
    checks = [replace(check, link=str(vehicle.link.address)) for check in checks]
    for check in checks:
        show(check)
    return facts, checks
