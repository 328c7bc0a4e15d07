"""Draws how well bearings to a set of transmitters fix a position over the field: GDOP, m per degree of bearing error.

In an SVG the group ids are `dilution` (the bands), `contours`, `contour-label-1` and on, `degenerate`,
`transmitter-L0` and `label-transmitter-L0`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from gcs.reports.canvas import TRANSMITTER, Extent, Style, add_legend, mark, new_sheet, save, to_points
from gcs.reports.labels import Label, draw_labels
from planner.dilution import dilution

_COLOURS = "viridis_r"
"""Seen alike with and without colour blindness; light is accurate."""
_HATCHED: Style = {"facecolor": "#DDDDDD", "edgecolor": "#666666", "hatch": "////"}
_CELLS = 240
_USELESS = 0.25
"""A fix that one degree moves by more than this part of the field's longer side is none."""
_BAR_IN = 0.6
_LABEL_GAP_PT = 16.0
_STEPS = tuple(digit * 10.0**power for power in range(-9, 12) for digit in (1.0, 2.0, 5.0))

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Field:
    """The dilution on a grid, m per degree: x and y, m, and values of shape (y, x); `useless` from where it is none."""

    x: _Floats
    y: _Floats
    gdop: _Floats
    useless: float

    @property
    def levels(self) -> list[float]:
        """Borders of the bands, from the best of the field to its worst that is not useless; none if all of it is."""
        good = self.gdop[self.gdop < self.useless]
        if not good.size:
            return []
        first, last = float(np.quantile(good, 0.01)), float(good.max())
        return [
            *[step for step in _STEPS if step <= first][-1:],
            *[step for step in _STEPS if first < step < last],
            *[step for step in _STEPS if last <= step][:1],
        ]


def draw_dilution_map(
    transmitters: Mapping[str, complex], path: Path, extent_m: Extent, heading_referenced: bool, title: str = ""
) -> None:
    """Write the map to `path` as SVG, PNG or PDF, by its suffix; places in the formation frame, m.

    The bands of colour are logarithmic, in steps of 1, 2 and 5. Hatched is where the bearings hardly fix a position,
    or not at all: in line with the transmitters, or without a heading reference on the circle through them. Raises
    ServiceError for another suffix and for a file that cannot be written.
    """
    how = "bearings from north" if heading_referenced else "angles between bearings"
    figure, axes = new_sheet(path, extent_m, f"{title}: dilution of {how}" if title else f"Dilution of {how}")
    field = _sampled(transmitters, extent_m, heading_referenced)
    entries: list[Artist] = [Line2D([], [], label="transmitter", linestyle="none", **TRANSMITTER)]
    _draw_bands(figure, axes, field)
    if field.gdop.max() > field.useless:
        _draw_degenerate(axes, field)
        entries.append(Patch(label=f"not fixed: over {field.useless:g} m per degree", **_HATCHED))
    inside = [
        Label(f"label-transmitter-{name}", name, at) for name, at in transmitters.items() if _inside(at, extent_m)
    ]
    for label in inside:
        mark(axes, label.at, gid=label.gid.removeprefix("label-"), zorder=6, **TRANSMITTER)
    add_legend(figure, entries)
    _draw_contours(axes, field, [label.at for label in inside])
    draw_labels(axes, inside)
    save(figure, path)


def _sampled(transmitters: Mapping[str, complex], extent_m: Extent, heading_referenced: bool) -> _Field:
    left, right, bottom, top = extent_m
    longer_m = max(right - left, top - bottom)
    x, y = (
        np.linspace(low, high, 2 + math.ceil((high - low) / longer_m * _CELLS))
        for low, high in ((left, right), (bottom, top))
    )
    places = np.array(list(transmitters.values()))
    gdop = dilution(x[None, :] + 1j * y[:, None], places, heading_referenced)
    useless = max(step for step in _STEPS if step <= _USELESS * longer_m)
    return _Field(x, y, np.radians(gdop), useless)


def _draw_bands(figure: Figure, axes: Axes, field: _Field) -> None:
    levels = field.levels
    if not levels:
        return
    norm = BoundaryNorm(levels, 256, extend="min")
    bands = axes.contourf(field.x, field.y, field.gdop, levels, cmap=_COLOURS, norm=norm, extend="min")
    bands.set_gid("dilution")
    figure.set_figheight(figure.get_figheight() + _BAR_IN)
    bar = figure.colorbar(bands, ax=axes, location="bottom", shrink=0.75, aspect=45, ticks=levels, spacing="uniform")
    bar.set_label("GDOP (m per degree)")
    bar.ax.set_xticks(levels, [f"{level:g}" for level in levels])


def _draw_degenerate(axes: Axes, field: _Field) -> None:
    colour, hatch = _HATCHED["facecolor"], _HATCHED["hatch"]
    levels = [field.useless, 2.0 * float(field.gdop.max())]
    hatched = axes.contourf(field.x, field.y, field.gdop, levels, colors=[colour], hatches=[hatch])
    hatched.set(gid="degenerate", edgecolor=_HATCHED["edgecolor"], linewidth=0.0)


def _draw_contours(axes: Axes, field: _Field, transmitters: Sequence[complex]) -> None:
    """Draw the borders of the bands, and write their values on them, clear of transmitters and one another."""
    levels = [level for level in field.levels if field.gdop.min() < level < field.gdop.max()]
    if not levels:
        return
    logarithms = np.log10(field.gdop)
    contours = axes.contour(field.x, field.y, logarithms, np.log10(levels), colors="#000000", linewidths=0.6)
    contours.set_gid("contours")
    taken = to_points(axes, transmitters)
    names = {float(np.log10(level)): f"{level:g}" for level in levels}
    number = 0
    for text in axes.clabel(contours, fmt=names, fontsize=7.5, inline=False, colors="#000000"):
        at = to_points(axes, [complex(*text.get_position())])
        if (np.abs(taken - at) < _LABEL_GAP_PT).any():
            text.remove()
            continue
        number += 1
        taken = np.concatenate([taken, at])
        text.set_gid(f"contour-label-{number}")
        text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _inside(at: complex, extent_m: Extent) -> bool:
    left, right, bottom, top = extent_m
    return left <= at.real <= right and bottom <= at.imag <= top
