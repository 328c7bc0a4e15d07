"""Line charts as small SVG: colours and sizes of text come from the page's style sheet."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from gcs.reports.markup import Content, Html, element

_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 10.0, 10.0, 34.0
_TICKS: Final = 5
_MOST_POINTS: Final = 500


@dataclass(frozen=True)
class Line:
    """A line through (x, y) points; None for y, or what is no number, breaks it."""

    points: Sequence[tuple[float, float | None]]
    style: str
    name: str


@dataclass(frozen=True)
class Level:
    """A horizontal line, and the band about it; none where `low` is `high`."""

    at: float
    style: str
    name: str
    low: float = 0.0
    high: float = 0.0


@dataclass(frozen=True)
class Panel:
    """A chart: what is drawn over which range. With `logarithmic` y must be positive."""

    x: tuple[float, float]
    y: tuple[float, float]
    x_label: str
    y_label: str
    lines: Sequence[Line] = ()
    levels: Sequence[Level] = field(default=())
    logarithmic: bool = False
    width: float = 480.0
    height: float = 200.0


def draw(panel: Panel, title: str) -> Html:
    """Return the chart; `title` is for those who cannot see it."""
    scale = _Scale(panel)
    return element(
        "svg",
        element("title", title),
        list(_grid(panel, scale)),
        [_level(panel, level, scale) for level in panel.levels],
        [_line(panel, line, scale) for line in panel.lines],
        _labels(panel),
        viewBox=f"0 0 {panel.width:g} {panel.height:g}",
        class_="chart",
        role="img",
    )


def spread(values: Sequence[float], least: float = 0.0) -> tuple[float, float]:
    """Return a range that shows all values with a little room, at least so wide."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    room = max(0.06 * (high - low), (least - (high - low)) / 2.0, 1e-6)
    return low - room, high + room


class _Scale:
    """From values to places in the picture."""

    def __init__(self, panel: Panel) -> None:
        self._panel = panel
        self._y = tuple(map(self._height, panel.y))

    def x(self, value: float) -> float:
        low, high = self._panel.x
        return _LEFT + (value - low) / ((high - low) or 1.0) * (self._panel.width - _LEFT - _RIGHT)

    def y(self, value: float) -> float:
        low, high = self._y
        share = (self._height(value) - low) / ((high - low) or 1.0)
        floor = self._panel.height - _BOTTOM
        return floor - min(max(share, -0.02), 1.02) * (floor - _TOP)

    def _height(self, value: float) -> float:
        return math.log10(max(value, 1e-9)) if self._panel.logarithmic else value


def _grid(panel: Panel, scale: _Scale) -> Iterator[Html]:
    right, floor = panel.width - _RIGHT, panel.height - _BOTTOM
    for value, text in ticks(*panel.y, logarithmic=panel.logarithmic):
        y = scale.y(value)
        yield element("line", x1=_LEFT, x2=right, y1=y, y2=y, class_="grid")
        yield element("text", text, x=_LEFT - 5.0, y=y + 4.0, text_anchor="end")
    for value, text in ticks(*panel.x):
        x = scale.x(value)
        yield element("line", x1=x, x2=x, y1=floor, y2=floor + 4.0, class_="grid")
        yield element("text", text, x=x, y=floor + 16.0, text_anchor="middle")


def _labels(panel: Panel) -> Content:
    middle = (panel.height - _BOTTOM + _TOP) / 2.0
    return [
        element("text", panel.x_label, x=(panel.width + _LEFT) / 2.0, y=panel.height - 3.0, text_anchor="middle"),
        element("text", panel.y_label, x=11.0, y=middle, text_anchor="middle", transform=f"rotate(-90 11 {middle:g})"),
    ]


def _level(panel: Panel, level: Level, scale: _Scale) -> Content:
    right, y = panel.width - _RIGHT, scale.y(level.at)
    band: Content = ()
    if level.low < level.high:
        top, bottom = scale.y(level.high), scale.y(level.low)
        band = element("rect", x=_LEFT, y=top, width=right - _LEFT, height=max(bottom - top, 0.5), class_="band")
    return [band, element("line", element("title", level.name), x1=_LEFT, x2=right, y1=y, y2=y, class_=level.style)]


def _line(panel: Panel, line: Line, scale: _Scale) -> Content:
    shown = [point for point in line.points if panel.x[0] <= point[0] <= panel.x[1]]
    every = max(1, math.ceil(len(shown) / _MOST_POINTS))
    pieces = _pieces([*shown[::every], *shown[-1:]])
    path = " ".join("M" + " ".join(f"{scale.x(x):.1f},{scale.y(y):.1f}" for x, y in piece) for piece in pieces)
    return element("path", element("title", line.name), d=path, class_=f"line {line.style}") if path else ()


def _pieces(points: Sequence[tuple[float, float | None]]) -> Iterator[list[tuple[float, float]]]:
    """Yield the unbroken pieces of a line."""
    piece: list[tuple[float, float]] = []
    for x, y in points:
        if y is not None and math.isfinite(y):
            piece.append((x, y))
        elif piece:
            yield piece
            piece = []
    if piece:
        yield piece


def ticks(low: float, high: float, *, logarithmic: bool = False) -> list[tuple[float, str]]:
    """Return round values within a range, and how they are written."""
    if logarithmic:
        powers = range(math.ceil(math.log10(max(low, 1e-9))), math.floor(math.log10(max(high, 1e-9))) + 1)
        return [(10.0**power, f"{10.0**power:g}") for power in powers]
    if not low < high:
        return []
    rough = (high - low) / _TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(digit * power for digit in (1.0, 2.0, 5.0, 10.0) if digit * power >= rough)
    digits = max(0, -math.floor(math.log10(step)))
    return [
        (number * step, f"{number * step:.{digits}f}")
        for number in range(math.ceil(low / step), math.floor(high / step) + 1)
    ]
