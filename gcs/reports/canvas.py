"""The sheet a figure is drawn on: the formation frame in metres, one scale for both axes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from gcs.errors import ServiceError

Extent = tuple[float, float, float, float]
"""Left, right, bottom and top of what is shown, m."""
Points = NDArray[np.complex128]
Style = dict[str, Any]

TRANSMITTER: Style = {"marker": "^", "markersize": 11, "markerfacecolor": "#F0E442", "markeredgecolor": "#000000"}
SLOT: Style = {"marker": "o", "markersize": 9, "markerfacecolor": "none", "markeredgecolor": "#000000"}
START: Style = {"marker": "s", "markersize": 9, "markerfacecolor": "#DDDDDD", "markeredgecolor": "#888888"}

_SUFFIXES = (".svg", ".png", ".pdf")
WIDTH_IN = 8.5
_LEGEND_IN = 0.8
_MARGIN = 0.07
_POINTS_PER_INCH, _DPI = 72.0, 160.0


def extent_of(points: Iterable[complex], margin: float = _MARGIN) -> Extent:
    """Return what shows all points, with a margin in parts of its longer side."""
    places = np.array(list(points))
    sides = [(float(part.min()), float(part.max())) for part in (places.real, places.imag)]
    margin_m = max(margin * max(high - low for low, high in sides), 1.0)
    (left, right), (bottom, top) = ((low - margin_m, high + margin_m) for low, high in sides)
    return left, right, bottom, top


def new_sheet(path: Path, extent: Extent, title: str, width_in: float = WIDTH_IN) -> tuple[Figure, Axes]:
    """Return an empty figure that will be written to `path`; ServiceError when its suffix names no format."""
    if path.suffix.lower() not in _SUFFIXES:
        raise ServiceError(f"{path}: the suffix of a figure must be one of {', '.join(_SUFFIXES)}")
    left, right, bottom, top = extent
    tallness = min(max((top - bottom) / (right - left), 0.4), 1.4)
    figure = Figure(figsize=(width_in, width_in * tallness + _LEGEND_IN), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xlabel="x, from L0 to L1 (m)", ylabel="y (m)")
    axes.grid(visible=True, color="#eeeeee", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_title(title, parse_math=False, gid="title")
    return figure, axes


def line(axes: Axes, points: Sequence[complex], gid: str, **style: Any) -> None:
    """Draw a line through points, or a mark at one, as a group of its own."""
    axes.plot([point.real for point in points], [point.imag for point in points], gid=gid, **style)


def mark(axes: Axes, at: complex, gid: str, **style: Any) -> None:
    """Draw a mark at a place, as a group of its own."""
    line(axes, [at], gid, linestyle="none", **style)


def add_legend(figure: Figure, entries: Sequence[Any], columns: int = 5) -> None:
    """Add the legend below everything; the layout then stands, so that places on the page can be asked for."""
    legend = figure.legend(handles=entries, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    legend.set_gid("legend")
    figure.draw_without_rendering()
    figure.set_layout_engine("none")


def to_points(axes: Axes, places: ArrayLike) -> Points:
    """Return where places stand on the page, points (1/72 inch)."""
    at = np.asarray(places, dtype=np.complex128)
    pixels = axes.transData.transform(np.column_stack([at.real, at.imag]))
    return np.asarray((pixels[:, 0] + 1j * pixels[:, 1]) * _POINTS_PER_INCH / _DPI)


def save(figure: Figure, path: Path) -> None:
    """Write the figure; ServiceError when the file cannot be written."""
    try:
        figure.savefig(path, dpi=_DPI)
    except OSError as error:
        raise ServiceError(f"{path}: the figure cannot be written: {error.strerror or error}") from error
