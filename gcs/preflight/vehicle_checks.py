"""The checks of one vehicle: one function each over what it told, in one tuple."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from drivers.mavlink.checks import Check, Finding, hard, passed, soft
from gcs.preflight.facts import VehicleFacts

GROUND_M: Final = 3.0
"""How far from 0 the height above home of a vehicle on the ground may be."""
ALTITUDE_TOLERANCE: Final = 0.05
LOW_BATTERY_PERCENT: Final = 40
EMPTY_BATTERY_PERCENT: Final = 20
SLOW_S: Final = 0.5
"""The round trip over which a link is slow for stopping a vehicle."""
NEAR_M: Final = 3.0
FAR_M: Final = 20.0
_NEAR_SIGMAS: Final = 3.0
_FAR_SIGMAS: Final = 10.0


@dataclass(frozen=True)
class VehicleCheck:
    """One check of one vehicle."""

    name: str
    judge: Callable[[VehicleFacts], Finding]


def check_vehicle(facts: VehicleFacts) -> Iterator[Check]:
    """Yield every check of one vehicle: those all have, and those of its autopilot's parameters."""
    for check in VEHICLE_CHECKS:
        yield Check.of(facts.name, check.name, check.judge(facts))
    for of_parameters in facts.autopilot.parameters.checks:
        yield Check.of(facts.name, of_parameters.name, of_parameters.judge(facts.parameters, facts.expected.intent))


def _autopilot(facts: VehicleFacts) -> Finding:
    firmware = ", ".join(sorted(identity.firmware for identity in facts.identities))
    return passed(f"{facts.autopilot.name} {firmware}".rstrip())


def _system_id(facts: VehicleFacts) -> Finding:
    numbers = {identity.uid for identity in facts.identities}
    if facts.contested or len(numbers) > 1:
        return hard("two autopilots answer to its system id", "Give each vehicle a system id of its own.")
    if not any(numbers):
        return soft(
            "the autopilot tells no number of its own, so nothing proves that it is not another vehicle's too",
            "Check by hand that each link leads to the vehicle it is named for.",
        )
    return passed("one autopilot answers")


def _telemetry(facts: VehicleFacts) -> Finding:
    if facts.missing_messages:
        return soft(
            f"{', '.join(facts.missing_messages)} asked for, not sent", "Check the link's bandwidth, and its direction."
        )
    return passed("every message asked for comes")


def _estimator(facts: VehicleFacts) -> Finding:
    if facts.not_ready:
        return hard(facts.not_ready, "Wait for it outdoors, and clear what the autopilot complains about.")
    return passed("it knows its position")


def _pre_arm(facts: VehicleFacts) -> Finding:
    own = facts.pre_arm
    if own is None:
        return soft("it is armed: its own checks are no longer run", "Land and disarm it to check it.")
    if own.complaints:
        return hard("; ".join(own.complaints), "Clear what the autopilot complains about.")
    if not own.healthy:
        return hard("it calls itself not ready to arm", "See its messages in its own ground station.")
    if own.not_run:
        return soft(own.not_run, "It calls itself ready to arm; its reasons, if any, come when it is armed.")
    return passed("its own checks find nothing")


def _battery(facts: VehicleFacts) -> Finding:
    percent = None if facts.battery is None else facts.battery.percent
    if percent is None:
        return soft("it does not know how full its battery is", "Check the battery by hand, or set up its monitor.")
    found = f"{percent} %"
    if percent < EMPTY_BATTERY_PERCENT:
        return hard(found, "Charge it.")
    return (
        soft(found, "Check that it is enough for the route and the way back.")
        if (percent < LOW_BATTERY_PERCENT)
        else passed(found)
    )


def _clock(facts: VehicleFacts) -> Finding:
    if facts.clock is None:
        return soft("it did not answer TIMESYNC", "Check the link in both directions.")
    found = f"answers in {facts.clock.round_trip_s * 1e3:.0f} ms at best"
    if facts.clock.round_trip_s > SLOW_S:
        run_on_m = facts.clock.uncertainty_s * facts.expected.intent.speed_mps
        return soft(f"{found}: it flies {run_on_m:.1f} m before a stop reaches it", "Use a quicker link.")
    return passed(found)


def _altitude(facts: VehicleFacts) -> Finding:
    height_m, armed, wanted_m = facts.height_m, facts.armed, facts.expected.intent.altitude_m
    if height_m is None:
        return soft("it has not told its height", "Check its position estimate.")
    if abs(height_m) <= GROUND_M:
        if armed:
            return soft(f"armed, {height_m:.1f} m above home", "Disarm it, unless you have armed it for this flight.")
        return passed(f"on the ground, {height_m:.1f} m above home")
    if not armed:
        return soft(f"disarmed, {height_m:.1f} m above its home", "Reboot it, so that its home is where it stands.")
    if abs(height_m - wanted_m) <= ALTITUDE_TOLERANCE * wanted_m:
        return soft(f"it already flies, {height_m:.1f} m above home", "It only enters its guided mode: agree on that.")
    return hard(
        f"it already flies, {height_m:.1f} m above home and not {wanted_m:g}",
        "Land it, or fly it to the playbook's altitude.",
    )


def _start(facts: VehicleFacts) -> Finding:
    if facts.place is None:
        return soft("it has not told where it is", "Check its position estimate.")
    apart_m, sigma_m = abs(facts.place - facts.expected.start), facts.expected.start_sigma_m
    found = f"{apart_m:.1f} m from its start in the playbook"
    if apart_m > max(FAR_M, _FAR_SIGMAS * sigma_m):
        return hard(found, "Check the site in the playbook, and that this is the vehicle meant; or bring it there.")
    if apart_m > max(NEAR_M, _NEAR_SIGMAS * sigma_m):
        return soft(found, "Bring it there, or correct the playbook.")
    return passed(found)


VEHICLE_CHECKS: Final = (
    VehicleCheck("autopilot", _autopilot),
    VehicleCheck("system id", _system_id),
    VehicleCheck("telemetry", _telemetry),
    VehicleCheck("estimator", _estimator),
    VehicleCheck("pre-arm", _pre_arm),
    VehicleCheck("battery", _battery),
    VehicleCheck("clock", _clock),
    VehicleCheck("altitude", _altitude),
    VehicleCheck("start", _start),
)
