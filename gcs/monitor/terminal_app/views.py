"""What the terminal monitor shows of a run: every view is a function of what is known of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Final

from rich.console import Group, RenderableType
from rich.text import Text

from drivers.bus.run_messages import Alert, ReceiverStatus, RunEvent, RunSetup, RunState
from gcs.monitor.history import Span
from gcs.monitor.terminal_app.grid import Grid
from gcs.monitor.terminal_app.words import (
    LEVEL_STYLES,
    LEVEL_WORDS,
    NOTHING,
    degrees,
    duration,
    number,
    state_style,
)

WIDE: Final = 120
"""From so many columns on there is room for more."""

_RELAY_HEAD: Final = (
    *("UAV", "slot", "wave", "state", "leg", "flies"),
    *("angle °", "stop °", "to go m", "min:s", "age s"),
)
_RELAY_MORE: Final = ("rate °/s", "off line m", "± m", "± °", "dropped")
_VEHICLE_HEAD: Final = (
    *("UAV", "id", "mode", "armed", "pilot", "air", "estimate"),
    *("height m", "m/s", "battery", "silent s", "nearest"),
)
_LINK_HEAD: Final = ("vehicles", "link", "state", "loss", "age s", "in", "out", "lost", "bad", "drop")


def head(state: RunState | None, setup: RunSetup | None, age_s: float | None, *, lost: bool, ended: bool) -> Text:
    """Return the first line: which run, what it is at, and how fresh this is."""
    if state is None:
        return Text("bearing-relay  no run yet", style="bold")
    placed = sum(receiver.state == "PLACED" for receiver in state.receivers)
    fresh = ("ended", "bold") if ended else ("OLD", "bold white on red") if lost else ("live", "green")
    return Text.assemble(
        (setup.playbook if setup is not None else state.run, "bold"),
        "  ",
        fresh,
        "" if age_s is None or ended or not lost else f" {age_s:.0f} s",
        f"  {state.phase}  {duration(state.elapsed_s)}  ",
        (f"{placed}/{len(state.receivers)} placed", "bold"),
        f"  to go {duration(state.to_go_s)}  on the air: ",
        (", ".join(state.on_air) or "nobody", "yellow"),
    )


def alert_lines(alerts: Sequence[Alert], most: int) -> Group:
    """Return the worst alerts, two lines each: what is wrong, and what to do; at last how many are left out."""
    shown = alerts if len(alerts) <= most else alerts[: most - 1]
    lines = list[Text]()
    for alert in shown:
        word = LEVEL_WORDS[alert.level]
        lines.append(
            Text.assemble(
                (f" {word} " if word else "", LEVEL_STYLES[alert.level]),
                " ",
                (alert.subject, "bold"),
                f": {alert.text}",
            )
        )
        if alert.way_out:
            lines.append(Text(f"   → {alert.way_out}", style="bold"))
    if left := len(alerts) - len(shown):
        lines.append(Text(f"… and {left} more", style="bold"))
    return Group(*lines)


def relay_table(state: RunState, width: int) -> Text:
    """Return every receiver: its state, leg, angle, distance and time to go, and how fresh its bearings are."""
    grid = Grid(_RELAY_HEAD + (_RELAY_MORE if width >= WIDE else ()), left=6)
    for receiver in state.receivers:
        grid.add(_receiver_row(receiver), state_style(receiver.state))
    return grid.text()


def _receiver_row(receiver: ReceiverStatus) -> tuple[str, ...]:
    leg, bearings = receiver.leg, receiver.bearings
    return (
        receiver.name,
        receiver.slot,
        str(receiver.wave),
        receiver.state,
        "" if leg is None else f"{leg.number}/{receiver.legs}",
        "" if leg is None else f"{leg.direction} {leg.guide}",
        "" if leg is None else degrees(leg.angle_rad),
        "" if leg is None else degrees(leg.stop_angle_rad),
        "" if leg is None else number(leg.remaining_m),
        duration(receiver.to_go_s),
        number(bearings.age_s),
        "" if leg is None else degrees(leg.rate_radps, signed=True),
        "" if leg is None or leg.cross_track_m is None else f"{leg.cross_track_m:+.1f}",
        "" if leg is None else number(leg.sigma_m, digits=2),
        degrees(bearings.sigma_rad),
        str(sum(bearings.dropped.values())),
    )


def leg_lines(state: RunState) -> list[Text]:
    """Return a line for every receiver whose angle closes on its stop: by how much, how fast, by whose bearings."""
    lines = list[Text]()
    for receiver in state.receivers:
        leg, bearings = receiver.leg, receiver.bearings
        if leg is None:
            continue
        first, second = leg.stop_reference
        off_rad = None if leg.angle_rad is None else leg.angle_rad - leg.stop_angle_rad
        lines.append(
            Text.assemble(
                (receiver.name, "bold"),
                f" {first}-{second}: {degrees(leg.angle_rad)}° → {degrees(leg.stop_angle_rad)}° ± "
                f"{degrees(leg.band_rad, digits=3)}°, off {degrees(off_rad, signed=True)}°, "
                f"{degrees(leg.rate_radps, signed=True)} °/s; hears {' '.join(bearings.heard) or 'nobody'}",
            )
        )
    return lines


def gantt(state: RunState, setup: RunSetup, spans: dict[str, list[Span]], width: int) -> Text:
    """Return who was, is and will be under way when: `=` flown, `-` planned, `#` placed, `!` held, `|` now."""
    ends_s = state.elapsed_s + (state.to_go_s or 0.0)
    total_s = max(setup.predicted_s, ends_s, 1.0)
    columns = max(width - 20, 10)
    now = min(int(state.elapsed_s / total_s * columns), columns - 1)
    grid = Grid(("UAV", "slot", f"0 … {duration(total_s)} min"), left=3)
    offset_s = _relay_began_s(spans)
    for route in setup.routes:
        cells = [" "] * columns
        _fill(cells, (route.begins_s + offset_s) / total_s, (route.ends_s + offset_s) / total_s, "-")
        for span in spans.get(route.receiver, ()):
            mark = {"WAITING": "", "PLACED": "#", "HELD": "!", "PILOT": "!", "FAILED": "!"}.get(span.state, "=")
            _fill(cells, span.from_s / total_s, (state.elapsed_s if span.to_s is None else span.to_s) / total_s, mark)
        cells[now] = "|"
        grid.add((route.receiver, route.slot, "".join(cells)))
    return grid.text()


def _relay_began_s(spans: dict[str, list[Span]]) -> float:
    """Return when the first receiver left its wait, s since the run began; 0 while none has."""
    return min((span.from_s for each in spans.values() for span in each if span.state != "WAITING"), default=0.0)


def _fill(cells: list[str], from_share: float, to_share: float, mark: str) -> None:
    if mark:
        first, last = int(from_share * len(cells)), int(to_share * len(cells))
        for column in range(max(first, 0), min(max(last, first + 1), len(cells))):
            cells[column] = mark


def vehicle_table(state: RunState, width: int) -> Text:
    """Return every vehicle as it tells of itself."""
    grid = Grid(_VEHICLE_HEAD + (("x m, y m",) if width >= WIDE else ()), left=7)
    for vehicle in state.vehicles:
        speed = None if vehicle.velocity_mps is None else abs(complex(*vehicle.velocity_mps))
        row = (
            vehicle.name,
            str(vehicle.system_id),
            vehicle.mode or NOTHING,
            "yes" if vehicle.armed else "no",
            "PILOT" if vehicle.pilot else "",
            "on" if vehicle.transmits else "",
            vehicle.estimator,
            number(vehicle.height_m),
            number(speed),
            NOTHING if vehicle.battery_percent is None else f"{vehicle.battery_percent} %",
            number(vehicle.silent_s),
            NOTHING if vehicle.nearest_m is None else f"{vehicle.nearest} {vehicle.nearest_m:.0f} m",
            NOTHING if vehicle.at_m is None else f"{vehicle.at_m[0]:.1f}, {vehicle.at_m[1]:.1f}",
        )
        grid.add(row, "bold magenta" if vehicle.pilot else "")
    return grid.text()


def health(state: RunState) -> Group:
    """Return how links, bus, sensors and recording fare."""
    links = Grid(_LINK_HEAD, left=3)
    for link in state.links:
        row = (
            link.vehicles,
            link.address,
            link.state,
            NOTHING if link.loss is None else f"{100.0 * link.loss:.1f} %",
            number(link.silent_s),
            *(str(count) for count in (link.received, link.sent, link.lost, link.refused, link.dropped)),
        )
        links.add(row, "" if link.state == "up" else "bold red")
    parts: list[RenderableType] = [
        links.text(),
        Text(f"bus: {_connected(state.bus.connected)}, {state.bus.strangers} reports of strangers"),
        Text(f"recording: {state.recording.problem or 'good'}, {state.recording.dropped} messages missing"),
        *(_dropped(receiver) for receiver in state.receivers if receiver.bearings.dropped),
    ]
    decisions = state.decisions
    if decisions is not None and decisions.counts[-1]:
        mean_s = decisions.sum_s / decisions.counts[-1]
        parts.append(Text(f"decisions: {decisions.counts[-1]}, on bearings {1e3 * mean_s:.0f} ms old on average"))
    return Group(*parts)


def _connected(connected: bool) -> str:
    return "connected" if connected else "NOT CONNECTED"


def _dropped(receiver: ReceiverStatus) -> Text:
    dropped = ", ".join(f"{count} {what.replace('_', ' ')}" for what, count in receiver.bearings.dropped.items())
    return Text(f"{receiver.name}'s bearing reports: {receiver.bearings.received}, of them dropped: {dropped}")


def log_lines(events: Iterable[RunEvent], most: int, wanted: str = "") -> list[Text]:
    """Return the latest events, the newest first; of those that hold `wanted`, when something is wanted."""
    matching = (event for event in events if wanted.casefold() in event.text.casefold())
    return [
        Text.assemble(
            f"{duration(event.elapsed_s):>7}  ",
            (LEVEL_WORDS[event.level] and f"{LEVEL_WORDS[event.level]} ", LEVEL_STYLES[event.level]),
            event.text,
        )
        for event in islice(matching, most)
    ]
