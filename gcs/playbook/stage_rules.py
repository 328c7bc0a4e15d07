"""What the stages of a playbook must keep to among each other: their order, and the names they speak of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from types import MappingProxyType
from typing import Final

from gcs.playbook.stages import AnyStage, EmissionStage, Fault, Inject, Land, Preflight, Relay, StageEntry, Takeoff
from gcs.playbook.suggestions import Location, Problem, suggestion

IN_THE_AIR: Final = frozenset({"locate", "relay", "hold", "measure", "return", "land"})
BEFORE_THE_RELAY: Final = frozenset({"locate", "plan"})
ONCE: Final = frozenset({"arm", "takeoff", "relay"})
ON_THE_LINK: Final[frozenset[Fault]] = frozenset(
    {"pilot", "link_cut", "link_faults", "telemetry_lost", "reboot", "battery_low", "transmitter_drift"}
)
"""These need a link of its own for each vehicle, with a tap on it."""
OF_A_UAV: Final[frozenset[Fault]] = ON_THE_LINK | {"freeze"}
OF_A_SENSOR: Final[frozenset[Fault]] = frozenset(
    {"sensor_silent", "sensor_stuck", "sensor_bias", "sensor_jump", "clock_step", "clock_drift", "report_faults"}
)
"""These need a simulated sensor."""
OF_A_TRANSMITTER: Final[frozenset[Fault]] = frozenset({"transmitter_silent"})
"""These, too."""
OF_THE_ROUTER: Final[frozenset[Fault]] = frozenset({"router_killed", "router_frozen"})
"""These need a bus router that is the run's own."""
WITHOUT_END: Final[frozenset[Fault]] = frozenset({"pilot", "reboot", "clock_step", "clock_drift", "service_killed"})
FOR_A_WHILE: Final[frozenset[Fault]] = frozenset({"service_frozen"})
_IMPAIRED: Final = ("loss", "duplication", "reordering", "delay_s", "jitter_s")
AMOUNTS: Final[Mapping[Fault, Sequence[str]]] = MappingProxyType(
    {
        "link_faults": _IMPAIRED,
        "report_faults": _IMPAIRED,
        "sensor_bias": ("bias_deg",),
        "sensor_jump": ("jump_deg",),
        "clock_step": ("step_s",),
        "clock_drift": ("drift_ppm",),
        "transmitter_drift": ("speed_mps",),
    }
)
"""One or more of these say how much of a fault there is."""
DETAILS: Final[Mapping[Fault, Sequence[str]]] = MappingProxyType(
    {"sensor_bias": ("of",), "sensor_jump": ("of",), "transmitter_drift": ("course_deg",)}
)
"""These may be said besides."""


@dataclass(frozen=True)
class NamedStage:
    """A stage as it is flown: its word, and its name, which is its word where the playbook gives it none."""

    name: str
    kind: str
    settings: AnyStage


@dataclass(frozen=True)
class Known:
    """Who is in a playbook."""

    uavs: Collection[str]
    transmitters: Collection[str]
    receivers: Collection[str]


def as_ever(*, land_after: bool) -> tuple[NamedStage, ...]:
    """Return the stages of a playbook that names none. When one fails the run ends, and all hover."""
    stages: dict[str, AnyStage] = {
        "preflight": Preflight(on_failure="abort"),
        "takeoff": Takeoff(on_failure="abort"),
        "relay": Relay(on_failure="abort"),
    }
    if land_after:
        stages["land"] = Land(on_failure="abort")
    return tuple(NamedStage(kind, kind, stage) for kind, stage in stages.items())


def named(entries: Sequence[StageEntry]) -> tuple[NamedStage, ...]:
    """Return the stages with their names: a word that comes again is numbered."""
    counted: Counter[str] = Counter()
    stages = []
    for entry in entries:
        counted[entry.kind] += 1
        number = f"-{counted[entry.kind]}" if counted[entry.kind] > 1 else ""
        stages.append(NamedStage(entry.stage.name or entry.kind + number, entry.kind, entry.stage))
    return tuple(stages)


def stage_problems(stages: Sequence[NamedStage], known: Known) -> Iterator[Problem]:
    """Yield what is wrong with the stages of a playbook, each at its place in the list."""
    names: set[str] = set()
    before: list[str] = []
    for number, stage in enumerate(stages):
        place = (number, stage.kind)
        if stage.name in names:
            yield (*place, "name"), f"{stage.name!r} is the name of an earlier stage: give each its own"
        yield from ((place, problem) for problem in _order_problems(stage.kind, before))
        if isinstance(stage.settings, EmissionStage):
            yield from _emission_problems(place, stage.settings, known)
        if isinstance(stage.settings, Inject):
            yield from _fault_problems(place, stage.settings, known)
            if stage.settings.at is not None and "relay" not in [later.kind for later in stages[number + 1 :]]:
                yield (*place, "at"), "no relay comes after it, whose moment it could be"
        names.add(stage.name)
        before.append(stage.kind)


def _order_problems(kind: str, before: Sequence[str]) -> Iterator[str]:
    if kind in ONCE and kind in before:
        yield f"there is one {kind} in a run"
    if kind in ("arm", "takeoff") and "preflight" not in before:
        yield "needs a preflight before it"
    if kind == "arm" and "takeoff" in before:
        yield "belongs before takeoff"
    if kind in BEFORE_THE_RELAY and "relay" in before:
        yield "belongs before the relay"
    if kind in IN_THE_AIR and "takeoff" not in before:
        yield "needs a takeoff before it"
    down = [earlier for earlier in before if earlier in ("return", "land")]
    if kind in (*IN_THE_AIR, "takeoff") and down:
        yield f"nobody flies any more after {down[0]}"


def _emission_problems(place: Location, stage: EmissionStage, known: Known) -> Iterator[Problem]:
    everyone = [*known.transmitters, *known.receivers]
    if not stage.on and not stage.off:
        yield place, "nobody is switched: it takes on: [NAME, ...] or off: [NAME, ...]"
    for key, names in (("on", stage.on), ("off", stage.off)):
        for number, name in enumerate(names):
            if name not in everyone:
                yield (*place, key, number), f"{name!r} is nobody of this playbook{suggestion(name, everyone)}"
    for number, name in enumerate(stage.off):
        if name in stage.on:
            yield (*place, "off", number), f"{name} is to be on and off"


def _fault_problems(place: Location, stage: Inject, known: Known) -> Iterator[Problem]:
    what, allowed = _struck_by(stage.fault, known)
    if stage.vehicle is None and what:
        yield (*place, "vehicle"), f"is missing: whom does {stage.fault} strike?"
    elif stage.vehicle is not None and not what:
        yield (*place, "vehicle"), f"{stage.fault} strikes no vehicle"
    elif stage.vehicle is not None and stage.vehicle not in allowed:
        yield (*place, "vehicle"), f"{stage.vehicle!r} is no {what}{suggestion(stage.vehicle, allowed)}"
    if stage.at is not None and stage.at.receiver not in known.receivers:
        unknown = f"{stage.at.receiver!r} is no receiver{suggestion(stage.at.receiver, known.receivers)}"
        yield (*place, "at", "receiver"), unknown
    if stage.at is not None and stage.after_s is not None:
        yield (*place, "after_s"), "it strikes at a moment of the relay (at: {..., after_s: ...}) or after_s from now"
    if stage.for_s is not None and stage.fault in WITHOUT_END:
        yield (*place, "for_s"), f"{stage.fault} does not end by itself"
    if stage.for_s is None and stage.fault in FOR_A_WHILE:
        yield (*place, "for_s"), f"is missing: {stage.fault} would last for ever, and so would the run"
    yield from (((*place, *where), problem) for where, problem in _amount_problems(stage, known))


def _struck_by(fault: Fault, known: Known) -> tuple[str, Collection[str]]:
    """Return what a fault strikes, and who is one; nothing and nobody where it strikes no vehicle."""
    if fault in OF_A_UAV:
        return "UAV", known.uavs
    if fault in OF_A_SENSOR:
        return "receiver", known.receivers
    if fault in OF_A_TRANSMITTER:
        return "transmitter", [*known.transmitters, *known.receivers]
    return "", ()


def _amount_problems(stage: Inject, known: Known) -> Iterator[Problem]:
    needed = AMOUNTS.get(stage.fault, ())
    if needed and not any(getattr(stage, word) for word in needed):
        which = f"one or more of {', '.join(needed)}" if len(needed) > 1 else f"{needed[0]}, other than 0"
        yield (), f"nothing fails: it takes {which}"
    for word in dict.fromkeys(chain(*AMOUNTS.values(), *DETAILS.values())):
        if getattr(stage, word) and word not in (*needed, *DETAILS.get(stage.fault, ())):
            its = [fault for table in (AMOUNTS, DETAILS) for fault, words in table.items() if word in words]
            yield (word,), f"goes with {' or '.join(its)}, not with {stage.fault}"
    on_the_air = [*known.transmitters, *known.receivers]
    if stage.of is not None and stage.of not in on_the_air:
        yield ("of",), f"{stage.of!r} is no transmitter{suggestion(stage.of, on_the_air)}"
    elif stage.of is not None and stage.of == stage.vehicle:
        yield ("of",), f"{stage.of} does not hear itself"
