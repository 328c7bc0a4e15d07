"""One fault as a value: what fails, whose, from which moment of the relay on, for how long; drawn from a seed."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal, get_args

import msgspec

from gcs.relay.states import ReceiverState
from planner.plan import RelayPlan

Kind = Literal[
    "report_loss",
    "report_duplication",
    "report_reordering",
    "report_delay",
    "report_jitter",
    "bus_lost",
    "clock_step",
    "clock_drift",
    "sensor_silent",
    "sensor_stuck",
    "sensor_bias",
    "sensor_jump",
    "transmitter_drift",
    "transmitter_silent",
    "telemetry_lost",
    "link_cut",
    "link_loss",
    "link_duplication",
    "link_reordering",
    "link_delay",
    "link_jitter",
    "vehicle_frozen",
    "vehicle_reboot",
    "battery_low",
    "pilot_receiver",
    "pilot_transmitter",
    "service_stopped",
    "service_killed",
    "router_restarted",
]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)

LYING: Final[frozenset[Kind]] = frozenset({"sensor_bias", "sensor_jump", "transmitter_drift"})
"""Under these, bearings say something else than the truth about the places that are taken for granted."""

OF_THE_LINK: Final[Mapping[Kind, str]] = MappingProxyType(
    {
        "link_loss": "loss",
        "link_duplication": "duplication",
        "link_reordering": "reordering",
        "link_delay": "delay_s",
        "link_jitter": "jitter_s",
    }
)
"""What these do to a radio: they befall what is sent to a vehicle, and what it says."""

_MOMENTS: Final = ("LOCATING", "LEG_1", "LEG_2", "VERIFYING")
_LATEST_S: Final = 8.0
_FOR_EVER_SHARE: Final = 0.5
_LASTS_S: Final = (0.3, 12.0)
_TWO_SHARE: Final = 0.2
_JUMPS_RAD: Final = tuple(math.radians(sign * jump) for jump in (45.0, 90.0, 180.0) for sign in (1, -1))


class Moment(msgspec.Struct, frozen=True):
    """So long after a receiver first entered a state."""

    receiver: str
    state: str
    after_s: float


class Fault(msgspec.Struct, frozen=True):
    """What fails. `amount` is in the unit of its kind, see `AMOUNTS`; `for_s` None: for ever."""

    kind: Kind
    target: str
    at: Moment
    for_s: float | None
    amount: float = 0.0
    course_rad: float = 0.0
    """Where a transmitter drifts."""
    of: str | None = None
    """The only transmitter whose bearings are wrong; None: all are."""


@dataclass(frozen=True)
class Amount:
    """From what to what the amount of a fault is drawn, the small as often as the large; `signed`: either way."""

    unit: str
    low: float
    high: float
    signed: bool = False


AMOUNTS: Final[Mapping[Kind, Amount]] = MappingProxyType(
    {
        "report_loss": Amount("share", 0.05, 0.5),
        "report_duplication": Amount("share", 0.1, 1.0),
        "report_reordering": Amount("share", 0.05, 0.5),
        "report_delay": Amount("s", 0.05, 2.0),
        "report_jitter": Amount("s", 0.05, 0.8),
        "clock_step": Amount("s", 0.02, 5.0, signed=True),
        "clock_drift": Amount("s/s", 2e-5, 5e-3, signed=True),
        "sensor_bias": Amount("rad", math.radians(0.5), math.radians(20.0), signed=True),
        "transmitter_drift": Amount("m/s", 0.1, 1.5),
        "link_loss": Amount("share", 0.05, 0.5),
        "link_duplication": Amount("share", 0.1, 1.0),
        "link_reordering": Amount("share", 0.05, 0.5),
        "link_delay": Amount("s", 0.05, 2.0),
        "link_jitter": Amount("s", 0.05, 0.8),
    }
)
_OF_A_TRANSMITTER: Final = frozenset({"transmitter_drift", "transmitter_silent", "pilot_transmitter"})
_FOR_EVER: Final = frozenset(
    {"clock_step", "clock_drift", "battery_low", "pilot_receiver", "pilot_transmitter", "service_killed"}
)
_FOR_A_WHILE: Final = frozenset({"vehicle_reboot", "service_stopped", "router_restarted"})


def draw_faults(plan: RelayPlan, seed: int) -> tuple[Fault, ...]:
    """Return one fault, sometimes two, for a relay: the same ones for the same plan and seed."""
    draws = random.Random(f"{seed}/faults")  # noqa: S311 - noise, not secrets
    return tuple(_draw(plan, draws) for _ in range(2 if draws.random() < _TWO_SHARE else 1))


def _draw(plan: RelayPlan, draws: random.Random) -> Fault:
    kind, route = draws.choice(KINDS), draws.choice(plan.routes)
    states = [state for state in _MOMENTS if not state.startswith("LEG") or int(state[-1]) <= len(route.legs)]
    moment = Moment(route.receiver, ReceiverState(draws.choice(states)).value, draws.uniform(0.0, _LATEST_S))
    heard = route.transmitters or (route.receiver,)
    for_ever, lasts_s = draws.random() < _FOR_EVER_SHARE, draws.uniform(*_LASTS_S)
    for_ever = kind in _FOR_EVER or (for_ever and kind not in _FOR_A_WHILE)
    return Fault(
        kind,
        draws.choice(heard) if kind in _OF_A_TRANSMITTER else route.receiver,
        moment,
        None if for_ever else lasts_s,
        _amount(kind, draws),
        draws.uniform(0.0, math.tau),
        draws.choice((None, *heard)) if kind in ("sensor_bias", "sensor_jump") else None,
    )


def _amount(kind: Kind, draws: random.Random) -> float:
    if kind == "sensor_jump":
        return draws.choice(_JUMPS_RAD)
    amount = AMOUNTS.get(kind)
    if amount is None:
        return 0.0
    drawn = math.exp(draws.uniform(math.log(amount.low), math.log(amount.high)))
    return drawn * (draws.choice((1.0, -1.0)) if amount.signed else 1.0)
