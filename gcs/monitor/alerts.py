"""What is wrong in a run and what to do about it, the worst first; nothing while all is well.

`run_alerts` are those that a run knows by itself; `alerts` adds what its telemetry, bearings, bus and recording tell.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
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
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import IN_FLIGHT, ReceiverState
from gcs.safety import SafetyLimits
from gcs.status import RelayView, RunStatus

LOW_BATTERY_PERCENT: Final = 30
EMPTY_BATTERY_PERCENT: Final = 15
OLD_BEARING_S: Final = 0.5
SILENT_S: Final = SafetyLimits().telemetry_gap_s
WORTH_SAYING_LOSS: Final = 0.01
WORTH_SAYING_SILENCE_S: Final = 0.5

_LEVELS: Final[tuple[Level, ...]] = ("alert", "warning", "info")
_IN_FLIGHT: Final = frozenset(state.value for state in IN_FLIGHT)
_CONTROL: Final = "bearing-relay control"
_LAND_IT: Final = "it hovers: land it from another station"
_HALTED: Final = (ReceiverState.PILOT, ReceiverState.HELD, ReceiverState.FAILED)


def run_alerts(status: RunStatus) -> list[Alert]:
    """Return what whoever started the run should know or do now."""
    found = [
        *_of_question(status.asked),
        *_of_relay(status),
        *_of_halted(status),
        *_of_takeovers(status),
        *_of_links(status.links()),
        *_of_recording(status.recording()),
        *_of_refused(status.refused_on_bus()),
    ]
    return _worst_first(found)


def alerts(
    sources: RunSources,
    receivers: Sequence[ReceiverStatus],
    vehicles: Sequence[VehicleState],
    bus: BusHealth,
    recording: RecordingHealth,
) -> list[Alert]:
    """Return everything that somebody at the field should know or do now."""
    found = [
        *run_alerts(sources.status),
        *_of_bus(bus),
        *_of_flights(receivers),
        *_of_vehicles(vehicles, sources.setup.min_separation_m),
        *(() if recording.problem == sources.status.recording() else _of_recording(recording.problem)),
        *_of_dropped(recording.dropped),
    ]
    return _worst_first(found)


def _worst_first(found: Iterable[Alert]) -> list[Alert]:
    return sorted(found, key=lambda alert: _LEVELS.index(alert.level))


def _of_question(asked: str | None) -> Iterator[Alert]:
    if asked is not None:
        yield Alert("alert", "run", asked, f"{_CONTROL} resume, or abort")


def _holding(status: RunStatus) -> RelayView | None:
    """Return the relay while it is held and can go on."""
    relay = status.relay
    return None if relay is None or relay.held is None or status.phase in ENDED_PHASES else relay


def _of_relay(status: RunStatus) -> Iterator[Alert]:
    if (relay := _holding(status)) is not None:
        stopped = ", ".join(record.name for record in status.records.values() if _stopped_with(relay, record))
        text = f"holds: {relay.held}" + (f"; stopped: {stopped}" if stopped else "")
        yield Alert("alert", "relay", text, " or ".join(relay.ways_out()))


def _stopped_with(relay: RelayView | None, record: ReceiverRecord) -> bool:
    """Return whether a receiver is held for no reason but the relay's: it needs no alert of its own."""
    return relay is not None and record.state is ReceiverState.HELD and record.reason == relay.held


def _of_halted(status: RunStatus) -> Iterator[Alert]:
    alike: dict[tuple[ReceiverState, str], list[str]] = {}
    for record in status.records.values():
        if record.state in _HALTED and not _stopped_with(_holding(status), record):
            alike.setdefault((record.state, record.reason), []).append(record.name)
    for (state, reason), names in sorted(alike.items(), key=lambda entry: _HALTED.index(entry[0][0])):
        way_out = {
            ReceiverState.PILOT: f"give it back in its guided mode, then {_CONTROL} release {names[0]}",
            ReceiverState.HELD: f"{_CONTROL} resume",
            ReceiverState.FAILED: _LAND_IT,
        }[state]
        way_out = _LAND_IT if status.phase in ENDED_PHASES else way_out
        yield Alert("alert", ", ".join(names), f"{state.value}: {reason}", way_out)


def _of_takeovers(status: RunStatus) -> Iterator[Alert]:
    others = set() if status.relay is None else status.relay.taken - status.records.keys()
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


def link_trouble(link: LinkStatus) -> str:
    """Return what is wrong with a link, in words; nothing while it fares well."""
    troubles: list[str] = []
    if link.state is LinkState.DOWN:
        troubles.append("down, tried again")
    elif math.isinf(link.silent_for_s):
        troubles.append("nothing heard yet")
    if link.loss_ratio is not None and link.loss_ratio >= WORTH_SAYING_LOSS:
        troubles.append(f"{100.0 * link.loss_ratio:.0f} % lost")
    if WORTH_SAYING_SILENCE_S <= link.silent_for_s < math.inf:
        troubles.append(f"silent {link.silent_for_s:.1f} s")
    if link.contested_system_ids:
        troubles.append(f"two autopilots with system id {', '.join(map(str, link.contested_system_ids))}")
    return ", ".join(troubles)


def _of_recording(problem: str | None) -> Iterator[Alert]:
    if problem:
        yield Alert("warning", "recording", problem, "the flight goes on; free the disk before the next")


def _of_refused(refused: str | None) -> Iterator[Alert]:
    if refused:
        yield Alert("warning", "bus", refused, "see who it is; a UAV that speaks for others needs keys made anew")


def _of_dropped(dropped: int) -> Iterator[Alert]:
    if dropped:
        text = f"{dropped} messages are missing in flight.mcap"
        yield Alert("warning", "recording", text, "use a faster disk next time")
