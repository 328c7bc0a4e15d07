"""Pictures of a study: how large the placement errors are, all of them and by receiver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gcs.errors import ServiceError
from gcs.reports.canvas import save

_BINS: Final = 40
_MOST_IN_LEGEND: Final = 24


def draw_placement_errors(errors_m: Mapping[str, Sequence[float]], folder: Path, title: str) -> list[Path]:
    """Draw the placement errors by receiver, m, into a folder; return the files. ServiceError when it cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ServiceError(f"the folder {folder} cannot be made: {error.strerror or error}") from error
    drawn = {name: np.sort(values) for name, values in errors_m.items() if values}
    if not drawn:
        return []
    paths = [folder / "placement_histogram.svg", folder / "placement_ecdf.svg"]
    figure, axes = _sheet(title, "receivers")
    _draw_histogram(axes, np.concatenate([*drawn.values()]))
    save(figure, paths[0])
    figure, axes = _sheet(title, "share of runs within it")
    _draw_distributions(axes, drawn)
    save(figure, paths[1])
    return paths


def _sheet(title: str, counted: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(8.5, 5.0), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlabel="placement error (m)", ylabel=counted)
    axes.grid(visible=True, color="#eeeeee", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_title(title, parse_math=False, gid="title")
    return figure, axes


def _draw_histogram(axes: Axes, errors_m: np.ndarray) -> None:
    axes.hist(errors_m, bins=_BINS, color="#0072B2")
    for share, style in ((50, "--"), (95, "-")):
        size_m = float(np.percentile(errors_m, share))
        axes.axvline(size_m, color="#D55E00", linestyle=style, label=f"{share} %: {size_m:.2f} m", gid=f"p{share}")
    axes.set_xlim(left=0.0)
    axes.legend(frameon=False)


def _draw_distributions(axes: Axes, errors_m: Mapping[str, np.ndarray]) -> None:
    """Draw the empirical distribution of each receiver, and of all together."""
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(errors_m)))
    for (name, values), colour in zip(errors_m.items(), colours, strict=True):
        axes.ecdf(values, color=colour, linewidth=1.2, label=name, gid=f"ecdf-{name}")
    axes.ecdf(np.concatenate([*errors_m.values()]), color="#000000", linewidth=2.2, label="all", gid="ecdf-all")
    axes.axhline(0.95, color="#888888", linewidth=0.8, linestyle=":")
    axes.set(xlim=(0.0, None), ylim=(0.0, 1.0))
    if len(errors_m) <= _MOST_IN_LEGEND:
        axes.legend(frameon=False, ncols=2, fontsize=9, loc="lower right")
