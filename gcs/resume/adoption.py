"""The vehicles of a run that goes on, as they are found: nothing takes off, is armed, or is put into another mode."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Final

from drivers.clock import Clock
from drivers.errors import VehicleError
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.checks import Check, Verdict
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits, StreamState
from drivers.mavlink.vehicle import Vehicle
from gcs.errors import ServiceError
from gcs.fleet import Member
from gcs.playbook.schema import Flight, Playbook
from gcs.preflight.expected import Expected, expectations
from gcs.preflight.facts import VehicleFacts, gather_facts
from gcs.preflight.fleet_checks import check_fleet
from gcs.preflight.report import PreflightReport
from gcs.preflight.vehicle_checks import GROUND_M, check_vehicle
from planner.plan import RelayPlan

_BEFORE_TAKE_OFF: Final = frozenset({"start", "pre-arm"})
"""Checks that say nothing of a vehicle in the air."""
_CHANGING: Final = frozenset({"battery", "clock", "telemetry"})
"""What of the rest may have become worse since the preflight: of all else the operator knows."""


@dataclass(frozen=True)
class Found:
    """The fleet as it was found: what flies each vehicle in the air, and who is on the ground, with the reason."""

    autopilots: Mapping[str, Autopilot]
    grounded: Mapping[str, str]


async def found_in_the_air(
    playbook: Playbook,
    plan: RelayPlan,
    vehicles: Mapping[str, Vehicle],
    without: Collection[str],
    say: Callable[[str], None],
) -> Found:
    """Look at every vehicle but those done `without`, all at once; `say` gets what is not as it should be.

    ServiceError when one is not heard or is wrong, and when too few are in the air to go on.
    """
    expected = expectations(playbook, plan)
    async with asyncio.TaskGroup() as group:
        tasks = [
            group.create_task(_looked_at(vehicle, expected[name]))
            for name, vehicle in vehicles.items()
            if name not in without
        ]
    outcomes = [task.result() for task in tasks]
    facts = [outcome for outcome in outcomes if isinstance(outcome, VehicleFacts)]
    checks = [outcome for outcome in outcomes if isinstance(outcome, Check)]
    for of in facts:
        unasked = _BEFORE_TAKE_OFF if _is_guided(vehicles[of.name], of.autopilot) else {*_BEFORE_TAKE_OFF, "altitude"}
        checks += [check for check in check_vehicle(of) if check.name not in unasked]
    report = PreflightReport((*checks, *check_fleet(facts)), {of.name: of.autopilot for of in facts})
    changing = tuple(check for check in report.checks if check.name in _CHANGING)
    for line in replace(report, checks=changing).lines(Verdict.SOFT):
        say(f"found: {line}")
    if not report.may_arm:
        raise ServiceError(
            "\n".join(
                [
                    "the run is not resumed, nothing was moved:",
                    *report.lines(Verdict.HARD),
                    "What cannot be put right is done without: --without NAME",
                ]
            )
        )
    grounded = {of.name: reason for of in facts if (reason := on_the_ground(of)) is not None}
    for name, reason in grounded.items():
        say(f"{name} takes no part: {reason}")
    require_enough(playbook, {*grounded, *without})
    return Found({name: of for name, of in report.autopilots.items() if name not in grounded}, grounded)


def member_as_it_flies(
    vehicle: Vehicle, autopilot: Autopilot, flight: Flight, clock: Clock, *, withheld: bool
) -> Member:
    """Return a vehicle with its stream, which nobody runs yet; one that is not in its guided mode is its pilot's.

    So is one that is `withheld`, whatever its mode: the operator has not released it.
    """
    limits = StreamLimits(lease_s=flight.lease_s, largest_speed_mps=flight.speed_mps)
    stream = SetpointStreamer(vehicle, autopilot, flight.altitude_m, limits, clock)
    if withheld:
        stream.state = StreamState.PILOT
    return Member(vehicle, autopilot, stream)


async def _looked_at(vehicle: Vehicle, expected: Expected) -> VehicleFacts | Check:
    """Return what a vehicle tells, or what kept it from telling."""
    try:
        return await gather_facts(vehicle, expected, lambda _check, _awaited: None)
    except VehicleError as error:
        found = Check(vehicle.name, "heartbeat", Verdict.HARD, error.problem, error.way_out)
        return replace(found, link=str(vehicle.link.address))


def _is_guided(vehicle: Vehicle, autopilot: Autopilot) -> bool:
    """Return whether a vehicle is the service's by its mode; at what height a pilot flies his is his matter."""
    return vehicle.telemetry.heartbeat is not None and autopilot.is_guided(vehicle.telemetry.heartbeat)


def on_the_ground(facts: VehicleFacts) -> str | None:
    """Return why a vehicle takes no part any more, or None for one in the air."""
    if not facts.armed:
        return "it is disarmed, and a run that is resumed arms nobody"
    lowest_m = min(GROUND_M, facts.expected.intent.altitude_m / 2.0)
    if facts.height_m is not None and abs(facts.height_m) <= lowest_m:
        return "it is on the ground, and a run that is resumed takes nobody off"
    return None


def require_enough(playbook: Playbook, missing: Collection[str]) -> None:
    """Return when there are transmitters to begin from and somebody to bring; ServiceError when not."""
    standing = [name for name in playbook.transmitters if name not in missing]
    if len(standing) < 2 or all(name in missing for name in playbook.receivers):
        raise ServiceError(
            f"the run is not resumed: {', '.join(sorted(missing))} are on the ground or done without, and it takes two "
            "transmitters and a receiver in the air. Land the others, and fly the playbook anew"
        )
