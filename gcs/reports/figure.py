"""Draws a relay plan, and the tracks flown, as a figure like the paper's figure 10: formation frame, metres.

In an SVG every element has its own group id: `slot-O1`, `start-U1`, `transmitter-L0`, `wave-1-U1`, `leg-1-U1`,
`arrow-1-U1`, `turning-1-U1`, `bearing-1-U1`, `track-U1`, those of the error ellipses, and `label-` before the first
three.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch
from matplotlib.patheffects import withStroke

from gcs.errors import ServiceError
from gcs.reports.canvas import (
    SLOT,
    START,
    TRANSMITTER,
    WIDTH_IN,
    Extent,
    Style,
    add_legend,
    extent_of,
    line,
    mark,
    new_sheet,
    save,
    to_points,
)
from gcs.reports.error_ellipses import draw_ellipses, ellipses_of, magnification
from gcs.reports.labels import Label, draw_labels
from planner.plan import Leg, RelayPlan
from planner.relay_accuracy import PlacementAccuracy

_LEGS: tuple[Style, ...] = (
    {"color": "#0072B2", "linestyle": "-", "linewidth": 1.8},
    {"color": "#D55E00", "linestyle": (0, (5, 1.5)), "linewidth": 1.8},
    {"color": "#009E73", "linestyle": (0, (1, 1)), "linewidth": 1.8},
)
"""Leg 1, leg 2 and the trim leg (colours of Okabe and Ito)."""
_BEARING: Style = {"color": "#888888", "linestyle": (0, (1, 3)), "linewidth": 0.7}
_TRACK: Style = {"color": "#000000", "linewidth": 0.7}
_TURNING: Style = {"marker": "D", "markersize": 3.4, "markerfacecolor": "#FFFFFF", "markeredgecolor": "#000000"}
_WAVE_PT = 6.0


def draw_plan(
    plan: RelayPlan,
    transmitters: Mapping[str, complex],
    path: Path,
    tracks: Mapping[str, Sequence[complex]] | None = None,
    title: str = "",
    accuracy: Mapping[str, PlacementAccuracy] | None = None,
    extent: Extent | None = None,
    width_in: float = WIDTH_IN,
) -> None:
    """Write the plan to `path` as SVG, PNG or PDF, by its suffix; places and tracks in the formation frame, m.

    A start carries the number of its wave. With `accuracy`, by receiver, the predicted 3-sigma error ellipses are drawn
    at turning points and slots. `extent` is what to show, by default everything; on a sheet less wide the writing is
    larger against it. Raises ServiceError for another suffix, a file that cannot be written, and a guide whose place is
    not known.
    """
    flown = {name: track for name, track in (tracks or {}).items() if track}
    shown = extent or extent_of(_points(plan, transmitters, flown))
    heading = f"{title}: total" if title else "Total"
    figure, axes = new_sheet(path, shown, f"{heading} length {plan.total_length_m:.2f} m", width_in)
    _draw_bearings(axes, plan, transmitters)
    ellipses = ellipses_of(plan, accuracy or {})
    factor = magnification(ellipses, max(shown[1] - shown[0], shown[3] - shown[2])) if ellipses else 1
    predicted = [draw_ellipses(axes, ellipses, factor)] if ellipses else []
    _draw_legs(axes, plan)
    for name, track in flown.items():
        line(axes, track, gid=f"track-{name}", zorder=4, **_TRACK)
    _draw_places(axes, plan, transmitters)
    add_legend(figure, [*_legend(plan, flown=bool(flown)), *predicted], columns=5 if width_in >= WIDTH_IN else 3)
    _draw_arrows(axes, plan)
    legs = [leg for _, _, leg in _legs(plan)]
    draw_labels(axes, _labels(plan, transmitters), [leg.end for leg in legs], [(leg.start, leg.end) for leg in legs])
    save(figure, path)


def _draw_places(axes: Axes, plan: RelayPlan, transmitters: Mapping[str, complex]) -> None:
    for name, at in transmitters.items():
        mark(axes, at, gid=f"transmitter-{name}", zorder=6, **TRANSMITTER)
    for route in plan.routes:
        mark(axes, route.target, gid=f"slot-{route.slot}", zorder=6, **SLOT)
        mark(axes, route.start, gid=f"start-{route.receiver}", zorder=6, **START)
        wave = axes.text(route.start.real, route.start.imag, str(route.wave), fontsize=_WAVE_PT, zorder=6.5)
        wave.set(
            horizontalalignment="center", verticalalignment="center_baseline", gid=f"wave-{route.wave}-{route.receiver}"
        )
        wave.set_path_effects([withStroke(linewidth=1.5, foreground=START["markerfacecolor"])])


def _labels(plan: RelayPlan, transmitters: Mapping[str, complex]) -> list[Label]:
    """Return every name, the ones to be placed first in front."""
    return [
        *(Label(f"label-transmitter-{name}", name, at) for name, at in transmitters.items()),
        *(Label(f"label-slot-{route.slot}", route.slot, route.target) for route in plan.routes),
        *(Label(f"label-start-{route.receiver}", route.receiver, route.start, bold=False) for route in plan.routes),
    ]


def _legs(plan: RelayPlan) -> Iterator[tuple[str, int, Leg]]:
    """Yield the receiver, the number from 1, and the leg, of every leg that has a length."""
    for route in plan.routes:
        for number, leg in enumerate(route.legs, 1):
            if leg.length_m > 0.0:
                yield route.receiver, number, leg


def _leg_style(number: int) -> Style:
    return _LEGS[min(number, len(_LEGS)) - 1]


def _points(
    plan: RelayPlan, transmitters: Mapping[str, complex], tracks: Mapping[str, Sequence[complex]]
) -> Iterator[complex]:
    """Yield every point the figure shows."""
    yield from transmitters.values()
    for route in plan.routes:
        yield from (route.start, *(leg.end for leg in route.legs), route.target)
    for track in tracks.values():
        yield from track


def _draw_bearings(axes: Axes, plan: RelayPlan, transmitters: Mapping[str, complex]) -> None:
    """Draw the line of bearing from the end of every leg to its guide: a transmitter, or a receiver in its slot."""
    places = {route.receiver: route.target for route in plan.routes} | dict(transmitters)
    for name, number, leg in _legs(plan):
        if leg.guide not in places:
            raise ServiceError(f"leg {number} of {name} is guided by {leg.guide}, whose place is not known")
        line(axes, [leg.end, places[leg.guide]], gid=f"bearing-{number}-{name}", zorder=1, **_BEARING)


def _draw_legs(axes: Axes, plan: RelayPlan) -> None:
    for name, number, leg in _legs(plan):
        line(axes, [leg.start, leg.end], gid=f"leg-{number}-{name}", zorder=3, **_leg_style(number))
    for route in plan.routes:
        for number, leg in enumerate(route.legs[:-1], 1):
            mark(axes, leg.end, gid=f"turning-{number}-{route.receiver}", zorder=6.3, **_TURNING)


def _draw_arrows(axes: Axes, plan: RelayPlan) -> None:
    """Draw an arrow head in the middle of every leg, no larger than the leg."""
    for name, number, leg in _legs(plan):
        begin, end = to_points(axes, [leg.start, leg.end])
        size = min(15.0, 0.8 * float(abs(end - begin)))
        middle, step = (leg.start + leg.end) / 2, (leg.end - leg.start) / abs(end - begin) * size * 0.25
        tail, head = ((at.real, at.imag) for at in (middle - step, middle + step))
        arrow = FancyArrowPatch(tail, head, arrowstyle="-|>", mutation_scale=size, shrinkA=0, shrinkB=0)
        arrow.set(color=_leg_style(number)["color"], linewidth=0, zorder=4.5, gid=f"arrow-{number}-{name}")
        axes.add_patch(arrow)


def _legend(plan: RelayPlan, *, flown: bool) -> list[Any]:
    names = ("leg 1", "leg 2", "trim leg")
    longest = max((number for _, number, _ in _legs(plan)), default=0)
    marks = {"transmitter": TRANSMITTER, "slot": SLOT, "start, its wave in it": START, "turning point": _TURNING}
    return [
        *(Line2D([], [], label=name, **_leg_style(number)) for number, name in enumerate(names[:longest], 1)),
        *(Line2D([], [], label=name, linestyle="none", **style) for name, style in marks.items()),
        Line2D([], [], label="bearing to the guide", **_BEARING),
        *([Line2D([], [], label="flown track", **_TRACK)] if flown else []),
    ]
