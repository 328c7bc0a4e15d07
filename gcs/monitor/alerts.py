"""What is wrong in a run and what to do about it, the worst first; nothing while all is well."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from drivers.bus.run_messages import (
    ENDED_PHASES,
    Alert,
    BusHealth,
    Level,
    ReceiverStatus,
    RecordingHealth,
    VehicleState,
)
from drivers.mavlink.link_status import LinkState, LinkStatus
from gcs.monitor.sources import RunSources
from gcs.monitor.troubles import link_trouble
from gcs.relay.states import IN_FLIGHT
from gcs.safety import SafetyLimits
from gcs.status import RelayView

LOW_BATTERY_PERCENT: Final = 30
EMPTY_BATTERY_PERCENT: Final = 15
OLD_BEARING_S: Final = 0.5
SILENT_S: Final = SafetyLimits().telemetry_gap_s

_LEVELS: Final[tuple[Level, ...]] = ("alert", "warning", "info")
_IN_FLIGHT: Final = frozenset(state.value for state in IN_FLIGHT)
_CONTROL: Final = "bearing-relay control"
_LAND_IT: Final = "it hovers: land it from another station"
_HALTED: Final = ("PILOT", "HELD", "FAILED")


def alerts(
    sources: RunSources,
    receivers: Sequence[ReceiverStatus],
    vehicles: Sequence[VehicleState],
    links: Sequence[tuple[str, LinkStatus]],
    bus: BusHealth,
    recording: RecordingHealth,
) -> list[Alert]:
    """Return everything that somebody at the field should know or do now."""
    ended = sources.status.phase in ENDED_PHASES
    found = [
        *_of_question(sources.status.asked),
        *(() if ended else _of_relay(sources.status.relay)),
        *_of_halted(receivers, ended=ended),
        *_of_takeovers(sources.status.relay, receivers),
        *_of_bus(bus),
        *_of_flights(receivers),
        *_of_vehicles(vehicles, sources.setup.min_separation_m),
        *_of_links(links),
        *_of_recording(recording, sources.status.recording()),
    ]
    return sorted(found, key=lambda alert: _LEVELS.index(alert.level))


def _of_question(asked: str | None) -> Iterator[Alert]:
    if asked is not None:
        yield Alert("alert", "run", asked, f"{_CONTROL} resume, or abort")


def _of_relay(relay: RelayView | None) -> Iterator[Alert]:
    if relay is not None and relay.held is not None:
        yield Alert("alert", "relay", f"holds: {relay.held}", " or ".join(relay.ways_out()))


def _of_halted(receivers: Sequence[ReceiverStatus], *, ended: bool) -> Iterator[Alert]:
    alike: dict[tuple[str, str], list[str]] = {}
    for receiver in receivers:
        if receiver.state in _HALTED:
            alike.setdefault((receiver.state, receiver.reason), []).append(receiver.name)
    for (state, reason), names in sorted(alike.items(), key=lambda entry: _HALTED.index(entry[0][0])):
        way_out = {
            "PILOT": f"give it back in its guided mode, then {_CONTROL} release {names[0]}",
            "HELD": f"{_CONTROL} resume",
            "FAILED": _LAND_IT,
        }[state]
        way_out = _LAND_IT if ended else way_out
        yield Alert("alert", ", ".join(names), f"{state}: {reason}", way_out)


def _of_takeovers(relay: RelayView | None, receivers: Sequence[ReceiverStatus]) -> Iterator[Alert]:
    others = set() if relay is None else set(relay.taken) - {receiver.name for receiver in receivers}
    for name in sorted(others):
        yield Alert("alert", name, "its pilot has it: no longer trusted to stand", f"{_CONTROL} release {name}")


def _of_bus(bus: BusHealth) -> Iterator[Alert]:
    if not bus.connected:
        yield Alert("alert", "bus", "the router cannot be reached: nobody flies", "check that the router runs")


def _of_flights(receivers: Sequence[ReceiverStatus]) -> Iterator[Alert]:
    for receiver in receivers:
        if receiver.state not in _IN_FLIGHT:
            continue
        age_s = receiver.bearings.age_s
        if receiver.reason and receiver.state.startswith("LEG"):
            yield Alert("warning", receiver.name, receiver.reason, "check its sensor and the transmitters")
        elif age_s is not None and age_s > OLD_BEARING_S:
            text = f"its last bearings are {age_s:.1f} s old"
            yield Alert("warning", receiver.name, text, "check its sensor and the bus")


def _of_vehicles(vehicles: Sequence[VehicleState], min_separation_m: float) -> Iterator[Alert]:
    too_near_m = SafetyLimits().separation_share * min_separation_m
    for vehicle in vehicles:
        name, percent = vehicle.name, vehicle.battery_percent
        if vehicle.silent_s is not None and vehicle.silent_s > SILENT_S:
            text = f"no telemetry for {vehicle.silent_s:.1f} s"
            yield Alert("alert" if vehicle.armed else "warning", name, text, "check its link and autopilot")
        if vehicle.estimator == "poor" and vehicle.armed:
            yield Alert(
                "alert", name, "its position estimate is poor", "check its GPS and compass; land it if it stays"
            )
        if percent is not None and percent <= LOW_BATTERY_PERCENT:
            level: Level = "alert" if percent <= EMPTY_BATTERY_PERCENT else "warning"
            yield Alert(level, name, f"{percent} % of its battery left", "land it before it lands itself")
        near_m = vehicle.nearest_m
        if vehicle.armed and near_m is not None and near_m < too_near_m and name < (vehicle.nearest or ""):
            text = f"only {near_m:.1f} m from {vehicle.nearest}"
            yield Alert("alert", name, text, f"{_CONTROL} hold, then have a pilot part them")


def _of_links(links: Sequence[tuple[str, LinkStatus]]) -> Iterator[Alert]:
    for vehicles, link in links:
        if trouble := link_trouble(link):
            grave = link.state is LinkState.DOWN or bool(link.contested_system_ids)
            text = f"{link.address}: {trouble}"
            yield Alert("alert" if grave else "warning", vehicles, text, "check antenna, range and power")


def _of_recording(recording: RecordingHealth, links_problem: str | None) -> Iterator[Alert]:
    for problem in dict.fromkeys(filter(None, (recording.problem, links_problem))):
        yield Alert("warning", "recording", problem, "the flight goes on; free the disk before the next")
    if recording.dropped:
        text = f"{recording.dropped} messages are missing in flight.mcap"
        yield Alert("warning", "recording", text, "use a faster disk next time")
