"""Rows of bars over time: the relay's Gantt chart and the emission ledger; plain elements, which fit any width."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.reports.chart import ticks
from gcs.reports.markup import Content, Html, element
from gcs.reports.run_data import RunData, state_intervals

_SHOWN_AS: Final = {
    "WAITING": "waiting",
    "LOCATING": "locating",
    "LEG_1": "leg-1",
    "LEG_2": "leg-2",
    "TRIMMING": "leg-3",
    "VERIFYING": "verifying",
    "PLACED": "placed",
    "HELD": "held",
    "PILOT": "pilot",
    "FAILED": "failed",
}


@dataclass(frozen=True)
class Bar:
    """A stretch of time, s, and what was then."""

    start_s: float
    end_s: float
    style: str
    name: str


@dataclass(frozen=True)
class Row:
    """A name, its bars, and a word at the end."""

    name: str
    bars: Sequence[Bar]
    note: str = ""


def relay_gantt(data: RunData, until_s: float | None = None) -> Html:
    """Return the states of every receiver over time, up to `until_s`, by default the end."""
    rows = [
        Row(name, [Bar(start, end, _style(state), state) for state, start, end in state_intervals(data, name)])
        for name in data.receivers
    ]
    seen = list(dict.fromkeys(bar.name for row in rows for bar in row.bars))
    legend = [(_style(state), state) for state in (*_SHOWN_AS, *seen) if state in seen]
    return element("div", _chart(rows, until_s or data.end_s), _legend(dict.fromkeys(legend)))


def emission_ledger(data: RunData) -> Html:
    """Return who was on the air when, and for how long."""
    rows = [
        Row(
            name,
            [Bar(start, end, "on-air", f"{name} on the air") for start, end in intervals],
            f"{sum(end - start for start, end in intervals):.0f} s",
        )
        for name, intervals in data.emission.items()
    ]
    return _chart(rows, data.end_s)


def _style(state: str) -> str:
    return _SHOWN_AS.get(state, "other")


def _chart(rows: Iterable[Row], end_s: float) -> Html:
    lasted_s = max(end_s, 1e-3)
    marks = [element("span", text, style=f"left:{100.0 * at / lasted_s:.2f}%") for at, text in ticks(0.0, lasted_s)]
    return element(
        "div",
        [_row(row, lasted_s) for row in rows],
        element("div", element("span", "s"), element("div", marks, class_="track"), element("span"), class_="row axis"),
        class_="bars",
    )


def _row(row: Row, lasted_s: float) -> Content:
    bars = [
        element(
            "i",
            title=f"{row.name}: {bar.name}, {bar.start_s:.1f} to {bar.end_s:.1f} s",
            class_=bar.style,
            style=f"left:{100.0 * bar.start_s / lasted_s:.3f}%;"
            f"width:{100.0 * max(min(bar.end_s, lasted_s) - bar.start_s, 0.0) / lasted_s:.3f}%",
        )
        for bar in row.bars
    ]
    return element(
        "div",
        element("b", row.name, title=row.name),
        element("div", bars, class_="track"),
        element("span", row.note),
        class_="row",
    )


def _legend(entries: Iterable[tuple[str, str]]) -> Html:
    return element(
        "p", [[element("i", class_=style), element("span", name)] for style, name in entries], class_="legend"
    )
