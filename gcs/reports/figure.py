"""Draws a relay plan, and the tracks flown, as a figure like the paper's figure 10: formation frame, metres.

In an SVG every element has its own group id: `slot-O1`, `start-U1`, `transmitter-L0`, `leg-1-U1`, `arrow-1-U1`,
`turning-1-U1`, `bearing-1-U1`, `track-U1`, and `label-` before the first three.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike, NDArray

from gcs.errors import ServiceError
from planner.plan import Leg, RelayPlan

_SUFFIXES = (".svg", ".png", ".pdf")
_WIDTH_IN = 8.5
_MARGIN = 0.07
_POINTS_PER_INCH, _DPI = 72.0, 160.0

_Style = dict[str, Any]
_LEGS: tuple[_Style, ...] = (
    {"color": "#0072B2", "linestyle": "-", "linewidth": 1.8},
    {"color": "#D55E00", "linestyle": (0, (5, 1.5)), "linewidth": 1.8},
    {"color": "#009E73", "linestyle": (0, (1, 1)), "linewidth": 1.8},
)
"""Leg 1, leg 2 and the trim leg (colours of Okabe and Ito)."""
_BEARING: _Style = {"color": "#888888", "linestyle": (0, (1, 3)), "linewidth": 0.7}
_TRACK: _Style = {"color": "#000000", "linewidth": 0.7}
_SLOT: _Style = {"marker": "o", "markersize": 9, "markerfacecolor": "none", "markeredgecolor": "#000000"}
_START: _Style = {"marker": "x", "markersize": 6, "markeredgecolor": "#444444", "markeredgewidth": 1.4}
_TURNING: _Style = {"marker": "D", "markersize": 3.4, "markerfacecolor": "#FFFFFF", "markeredgecolor": "#000000"}
_TRANSMITTER: _Style = {"marker": "^", "markersize": 11, "markerfacecolor": "#F0E442", "markeredgecolor": "#000000"}

_LABEL_PT = 8.0
_GAPS_PT = (7.0, 10.0, 14.0, 19.0)
_DIRECTIONS = np.exp(1j * np.arange(24) * np.pi / 12)
_SAMPLES = np.linspace(0.0, 1.0, 60)
_MARK_WEIGHT, _LABEL_WEIGHT, _GAP_WEIGHT = 30.0, 200.0, 0.4

_Points = NDArray[np.complex128]


def draw_plan(
    plan: RelayPlan,
    transmitters: Mapping[str, complex],
    path: Path,
    tracks: Mapping[str, Sequence[complex]] | None = None,
    title: str = "",
) -> None:
    """Write the plan to `path` as SVG, PNG or PDF, by its suffix; places and tracks in the formation frame, m.

    Raises ServiceError for another suffix, a file that cannot be written, and a guide whose place is not known.
    """
    if path.suffix.lower() not in _SUFFIXES:
        raise ServiceError(f"{path}: the suffix of a figure must be one of {', '.join(_SUFFIXES)}")
    flown = {name: track for name, track in (tracks or {}).items() if track}
    figure = Figure(dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    _frame(figure, axes, _extent(plan, transmitters, flown))
    heading = f"{title}: total" if title else "Total"
    axes.set_title(f"{heading} length {plan.total_length_m:.2f} m", parse_math=False, gid="title")
    _draw_bearings(axes, plan, transmitters)
    _draw_legs(axes, plan)
    for name, track in flown.items():
        _line(axes, track, gid=f"track-{name}", zorder=4, **_TRACK)
    places = _places(plan, transmitters)
    for place in places:
        _line(axes, [place.at], gid=place.gid, linestyle="none", zorder=6, **place.style)
    _add_legend(figure, plan, flown=bool(flown))
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    _draw_arrows(axes, plan)
    _draw_labels(axes, places, plan)
    try:
        figure.savefig(path, dpi=_DPI)
    except OSError as error:
        raise ServiceError(f"{path}: the figure cannot be written: {error.strerror or error}") from error


@dataclass(frozen=True)
class _Place:
    """A named, marked place."""

    gid: str
    name: str
    at: complex
    style: Mapping[str, Any]


def _places(plan: RelayPlan, transmitters: Mapping[str, complex]) -> list[_Place]:
    """Return every place that carries a name, the ones to be labelled first in front."""
    return [
        *(_Place(f"transmitter-{name}", name, at, _TRANSMITTER) for name, at in transmitters.items()),
        *(_Place(f"slot-{route.slot}", route.slot, route.target, _SLOT) for route in plan.routes),
        *(_Place(f"start-{route.receiver}", route.receiver, route.start, _START) for route in plan.routes),
    ]


def _legs(plan: RelayPlan) -> Iterator[tuple[str, int, Leg]]:
    """Yield the receiver, the number from 1, and the leg, of every leg that has a length."""
    for route in plan.routes:
        for number, leg in enumerate(route.legs, 1):
            if leg.length_m > 0.0:
                yield route.receiver, number, leg


def _leg_style(number: int) -> _Style:
    return _LEGS[min(number, len(_LEGS)) - 1]


def _extent(plan: RelayPlan, transmitters: Mapping[str, complex], tracks: Mapping[str, Sequence[complex]]) -> _Points:
    """Return every point the figure shows."""
    planned = (at for route in plan.routes for at in (route.start, *(leg.end for leg in route.legs), route.target))
    return np.array([*transmitters.values(), *planned, *(at for track in tracks.values() for at in track)])


def _frame(figure: Figure, axes: Axes, points: _Points) -> None:
    sides = [(float(part.min()), float(part.max())) for part in (points.real, points.imag)]
    margin_m = max(_MARGIN * max(high - low for low, high in sides), 1.0)
    (left, right), (bottom, top) = ((low - margin_m, high + margin_m) for low, high in sides)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xlabel="x, from L0 to L1 (m)", ylabel="y (m)")
    axes.grid(visible=True, color="#eeeeee", linewidth=0.6)
    axes.set_axisbelow(True)
    tallness = min(max((top - bottom) / (right - left), 0.4), 1.4)
    figure.set_size_inches(_WIDTH_IN, _WIDTH_IN * tallness + 0.8)


def _line(axes: Axes, points: Sequence[complex], gid: str, **style: Any) -> None:
    axes.plot([point.real for point in points], [point.imag for point in points], gid=gid, **style)


def _draw_bearings(axes: Axes, plan: RelayPlan, transmitters: Mapping[str, complex]) -> None:
    """Draw the line of bearing from the end of every leg to its guide: a transmitter, or a receiver in its slot."""
    places = {route.receiver: route.target for route in plan.routes} | dict(transmitters)
    for name, number, leg in _legs(plan):
        if leg.guide not in places:
            raise ServiceError(f"leg {number} of {name} is guided by {leg.guide}, whose place is not known")
        _line(axes, [leg.end, places[leg.guide]], gid=f"bearing-{number}-{name}", zorder=1, **_BEARING)


def _draw_legs(axes: Axes, plan: RelayPlan) -> None:
    for name, number, leg in _legs(plan):
        _line(axes, [leg.start, leg.end], gid=f"leg-{number}-{name}", zorder=3, **_leg_style(number))
    for route in plan.routes:
        for number, leg in enumerate(route.legs[:-1], 1):
            _line(axes, [leg.end], gid=f"turning-{number}-{route.receiver}", linestyle="none", zorder=5, **_TURNING)


def _draw_arrows(axes: Axes, plan: RelayPlan) -> None:
    """Draw an arrow head in the middle of every leg, no larger than the leg."""
    for name, number, leg in _legs(plan):
        begin, end = _to_points(axes, [leg.start, leg.end])
        size = min(15.0, 0.8 * float(abs(end - begin)))
        middle, step = (leg.start + leg.end) / 2, (leg.end - leg.start) / abs(end - begin) * size * 0.25
        tail, head = ((at.real, at.imag) for at in (middle - step, middle + step))
        arrow = FancyArrowPatch(tail, head, arrowstyle="-|>", mutation_scale=size, shrinkA=0, shrinkB=0)
        arrow.set(color=_leg_style(number)["color"], linewidth=0, zorder=4.5, gid=f"arrow-{number}-{name}")
        axes.add_patch(arrow)


def _add_legend(figure: Figure, plan: RelayPlan, *, flown: bool) -> None:
    names = ("leg 1", "leg 2", "trim leg")
    longest = max((number for _, number, _ in _legs(plan)), default=0)
    marks = {"transmitter": _TRANSMITTER, "slot": _SLOT, "start": _START, "turning point": _TURNING}
    entries = [
        *(Line2D([], [], label=name, **_leg_style(number)) for number, name in enumerate(names[:longest], 1)),
        *(Line2D([], [], label=name, linestyle="none", **style) for name, style in marks.items()),
        Line2D([], [], label="bearing to the guide", **_BEARING),
        *([Line2D([], [], label="flown track", **_TRACK)] if flown else []),
    ]
    figure.legend(handles=entries, loc="outside lower center", ncols=5, frameon=False, fontsize=9).set_gid("legend")


def _to_points(axes: Axes, places: ArrayLike) -> _Points:
    """Return where places stand on the page, points."""
    at = np.asarray(places, dtype=np.complex128)
    pixels = axes.transData.transform(np.column_stack([at.real, at.imag]))
    return np.asarray((pixels[:, 0] + 1j * pixels[:, 1]) * _POINTS_PER_INCH / _DPI)


def _draw_labels(axes: Axes, places: Sequence[_Place], plan: RelayPlan) -> None:
    """Write every place's name beside it, where it covers the fewest marks, legs and other names."""
    anchors = _to_points(axes, [place.at for place in places])
    lines = [_to_points(axes, leg.start + (leg.end - leg.start) * _SAMPLES) for _, _, leg in _legs(plan)]
    marks = np.concatenate([anchors, *(line[-1:] for line in lines)])
    crowd = np.concatenate([marks, *lines])
    weights = np.where(np.arange(crowd.size) < marks.size, _MARK_WEIGHT, 1.0)
    taken: list[tuple[complex, complex]] = []
    for place, anchor in zip(places, anchors.tolist(), strict=True):
        half = _LABEL_PT * complex(0.36 * len(place.name), 0.55)
        offsets = _offsets(half)
        cost = _covers(anchor + offsets, half + 2.0 + 2.0j, crowd) @ weights
        cost += _GAP_WEIGHT * np.repeat(_GAPS_PT, _DIRECTIONS.size)
        for centre, other in taken:
            cost += _LABEL_WEIGHT * _covers(anchor + offsets, half + other, np.array([centre]))[:, 0]
        offset = complex(offsets[np.argmin(cost)])
        taken.append((anchor + offset, half))
        label = axes.annotate(
            place.name,
            (place.at.real, place.at.imag),
            (offset.real, offset.imag),
            textcoords="offset points",
            horizontalalignment="center",
            verticalalignment="center",
            fontsize=_LABEL_PT,
            fontweight="normal" if place.style is _START else "bold",
        )
        label.set(parse_math=False, zorder=7, gid=f"label-{place.gid}")
        label.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _offsets(half: complex) -> _Points:
    """Return where the middle of a label of this half size may lie about its place, nearest first, points."""
    return np.concatenate(
        [_DIRECTIONS.real * (half.real + gap) + 1j * _DIRECTIONS.imag * (half.imag + gap) for gap in _GAPS_PT]
    )


def _covers(centres: _Points, half: complex, points: _Points) -> NDArray[np.float64]:
    """Return 1 where the box about a centre (row) covers a point (column), else 0."""
    apart = points[None, :] - centres[:, None]
    return np.where((np.abs(apart.real) < half.real) & (np.abs(apart.imag) < half.imag), 1.0, 0.0)
