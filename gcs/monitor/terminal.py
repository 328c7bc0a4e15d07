"""Live progress in the terminal, and the result table at the end."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from typing import Any, Final

import msgspec
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from drivers.bus.refusals import Refusals
from gcs.monitor.alerts import run_alerts
from gcs.monitor.terminal_app.views import alert_lines
from gcs.monitor.terminal_app.words import state_style
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import ReceiverState
from gcs.status import RunStatus

REFRESH_S: Final = 0.2
_MESSAGES_SHOWN: Final = 5
_ALERTS_SHOWN: Final = 6


async def show_progress(console: Console, status: RunStatus) -> None:
    """Show the run until cancelled: a live table on a terminal, a line per message elsewhere."""
    if not console.is_terminal:
        await _print_messages(console, status)
        return
    with Live(console=console, auto_refresh=False, transient=True) as live:
        while True:
            live.update(progress_view(status), refresh=True)
            await asyncio.sleep(REFRESH_S)


async def _print_messages(console: Console, status: RunStatus) -> None:
    shown = 0
    try:
        while True:
            shown = _print_new(console, status, shown)
            await asyncio.sleep(REFRESH_S)
    finally:
        _print_new(console, status, shown)


def _print_new(console: Console, status: RunStatus, shown: int) -> int:
    new = min(status.said - shown, len(status.messages))
    for time_s, message in list(status.messages)[len(status.messages) - new :]:
        console.print(Text(f"{time_s:7.1f} s  {message}"), soft_wrap=True)
    return status.said


def progress_view(status: RunStatus) -> Group:
    """Return what the live screen shows now."""
    placed = sum(record.state is ReceiverState.PLACED for record in status.records.values())
    head = Text.assemble(
        (status.playbook, "bold"),
        f"  {status.phase}  {status.elapsed_s():.0f} s  {placed}/{len(status.records)} placed  on the air: ",
        (", ".join(sorted(status.on_air)) or "nobody", "yellow"),
    )
    table = Table(box=None, pad_edge=False, header_style="bold", expand=False)
    table.add_column("UAV", no_wrap=True)
    table.add_column("slot", no_wrap=True)
    table.add_column("state", no_wrap=True)
    table.add_column("flies", no_wrap=True)
    for name in ("angle °", "stop °", "to go m", "off line m"):
        table.add_column(name, justify="right", no_wrap=True)
    for record in status.records.values():
        table.add_row(*_progress_row(record), style=state_style(record.state.value))
    messages = [Text(f"{time_s:7.1f} s  {text}") for time_s, text in list(status.messages)[-_MESSAGES_SHOWN:]]
    return Group(head, table, alert_lines(run_alerts(status), _ALERTS_SHOWN), *messages)


def _progress_row(record: ReceiverRecord) -> tuple[str, ...]:
    leg, common = record.leg, (record.name, record.route.slot, record.state.value)
    if leg is None or leg.estimate is None or leg.measured_angle_rad is None:
        return (*common, "", "", "", "", "")
    return (
        *common,
        f"{leg.leg.direction} {leg.leg.guide}",
        f"{math.degrees(leg.measured_angle_rad):.2f}",
        f"{math.degrees(leg.leg.stop_angle_rad):.2f}",
        f"{leg.estimate.remaining_m:.1f}",
        f"{leg.estimate.cross_track_m:+.1f}",
    )


def result_table(report: Mapping[str, Any]) -> Table:
    """Return the result of a run as a table."""
    table = Table(title=f"{report['playbook']}: {report['outcome']}", title_style="bold", header_style="bold")
    for name in ("UAV", "slot", "state", "route"):
        table.add_column(name, no_wrap=True)
    for name in ("planned m", "flown m", "stop error °", "placement error m"):
        table.add_column(name, justify="right")
    for receiver in report["receivers"]:
        legs = receiver["legs"]
        errors = [leg["stop_angle_error_deg"] for leg in legs if leg["stop_angle_error_deg"] is not None]
        table.add_row(
            receiver["name"],
            receiver["slot"],
            Text(receiver["state"], style=state_style(receiver["state"])),
            receiver["route_model"],
            f"{sum(leg['planned_length_m'] for leg in legs):.2f}",
            f"{sum(leg['flown_length_m'] or 0.0 for leg in legs):.2f}",
            f"{max(errors, key=abs):+.3f}" if errors else "–",
            "–" if receiver["placement_error_m"] is None else f"{receiver['placement_error_m']:.2f}",
        )
    return table


def result_lines(report: Mapping[str, Any]) -> list[str]:
    """Return the totals of a run, a line each."""
    separation = report["min_separation_m"]
    reports = report["bearing_reports"]
    dropped = ", ".join(
        f"{count} {kind.replace('_', ' ')}" for kind, count in reports.items() if kind != "received" and count
    )
    return [
        f"planned {report['planned_total_length_m']:.2f} m, flown {report['flown_total_length_m']:.2f} m "
        f"(straight lines: {report['straight_line_bound_m']:.2f} m)",
        f"{report['duration_s']:.0f} s, {report['emission_transmitter_s']:.0f} transmitter-seconds, "
        f"closest approach {'–' if separation is None else f'{separation:.1f} m'}",
        f"{reports['received']} bearing reports" + (f" ({dropped})" if dropped else ""),
        *_refused_line(report.get("refused_on_bus")),
    ]


def _refused_line(counted: Mapping[str, Any] | None) -> list[str]:
    refused = msgspec.convert(counted or {}, Refusals)
    return [str(refused)] if refused.total else []
