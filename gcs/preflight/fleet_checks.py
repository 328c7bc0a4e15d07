"""The checks between vehicles: one function each over what all of them told, in one tuple."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

from drivers.mavlink.checks import Check, Finding, hard, passed, soft
from gcs.preflight.facts import VehicleFacts

FLEET: Final = "fleet"
"""Stands for the vehicle of a check that all of them pass."""
LEVEL_M: Final = 3.0
"""By how much homes may differ in altitude: vehicles fly at one height above their own."""
FAR_OFF_LEVEL_M: Final = 10.0
RETURN_APART_M: Final = 3.0


@dataclass(frozen=True)
class FleetCheck:
    """One check between vehicles: whatever is wrong, by the name of the vehicle, and what it is to find nothing."""

    name: str
    judge: Callable[[Sequence[VehicleFacts]], Iterator[tuple[str, Finding]]]
    nothing_found: str


def check_fleet(fleet: Sequence[VehicleFacts]) -> Iterator[Check]:
    """Yield every check between vehicles: what is wrong with each, or once for all that nothing is."""
    for check in FLEET_CHECKS:
        findings = list(check.judge(fleet)) or [(FLEET, passed(check.nothing_found))]
        for name, finding in findings:
            yield Check.of(name, check.name, finding)


def _identity(fleet: Sequence[VehicleFacts]) -> Iterator[tuple[str, Finding]]:
    for one, other in combinations(fleet, 2):
        shared = {identity.uid for identity in one.identities} & {identity.uid for identity in other.identities}
        if any(shared):
            yield (
                other.name,
                hard(f"is the same autopilot as {one.name}", "Correct the link or system id of one in the playbook."),
            )


def _home_level(fleet: Sequence[VehicleFacts]) -> Iterator[tuple[str, Finding]]:
    homes_m = {facts.name: facts.home_altitude_m for facts in fleet if facts.home_altitude_m is not None}
    if not homes_m:
        return
    middle_m = statistics.median(homes_m.values())
    for name, home_m in homes_m.items():
        off_m = home_m - middle_m
        found = f"its home is {abs(off_m):.1f} m {'above' if off_m > 0 else 'below'} the others'"
        if abs(off_m) > FAR_OFF_LEVEL_M:
            yield name, hard(found, "Check its altitude; all fly at one height above their own homes.")
        elif abs(off_m) > LEVEL_M:
            yield name, soft(found, "It will fly that much higher or lower than the others.")


def _apart(fleet: Sequence[VehicleFacts]) -> Iterator[tuple[str, Finding]]:
    for one, other in combinations(fleet, 2):
        if one.place is None or other.place is None:
            continue
        apart_m, wanted_m = abs(one.place - other.place), other.expected.min_separation_m
        found = f"{apart_m:.1f} m from {one.name}"
        if apart_m < wanted_m / 2.0:
            yield other.name, hard(found, f"Put them {wanted_m:g} m apart; is one named for the other's link?")
        elif apart_m < wanted_m:
            yield other.name, soft(found, f"The playbook's separation is {wanted_m:g} m: the run would hold them.")


def _return_altitude(fleet: Sequence[VehicleFacts]) -> Iterator[tuple[str, Finding]]:
    returning: dict[str, float] = {}
    for facts in fleet:
        altitude_m = facts.autopilot.parameters.failsafe_return_altitude_m(facts.parameters)
        if altitude_m is None:
            continue
        near = [name for name, other_m in returning.items() if abs(altitude_m - other_m) < RETURN_APART_M]
        returning[facts.name] = altitude_m
        if near:
            found = f"flies home at {altitude_m:g} m when this service has gone, and so does {near[0]}"
            yield facts.name, soft(found, f"Let them land instead, or return {RETURN_APART_M:g} m apart.")


FLEET_CHECKS: Final = (
    FleetCheck("identity", _identity, "no autopilot is two vehicles"),
    FleetCheck("home level", _home_level, "all homes at one level"),
    FleetCheck("apart", _apart, "all stand apart"),
    FleetCheck("return altitude", _return_altitude, "no two fly home at one altitude"),
)
