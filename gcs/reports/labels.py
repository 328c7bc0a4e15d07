"""Writes names beside their places, where they cover the fewest marks, lines and other names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from gcs.reports.canvas import Points, to_points

_LABEL_PT = 8.0
_GAPS_PT = (7.0, 10.0, 14.0, 19.0)
_DIRECTIONS = np.exp(1j * np.arange(24) * np.pi / 12)
_SAMPLES = np.linspace(0.0, 1.0, 60)
_MARK_WEIGHT, _LABEL_WEIGHT, _EDGE_WEIGHT, _GAP_WEIGHT = 30.0, 200.0, 500.0, 0.4


@dataclass(frozen=True)
class Label:
    """A name and its place, m."""

    gid: str
    text: str
    at: complex
    bold: bool = True


def draw_labels(
    axes: Axes, labels: Sequence[Label], marks: Sequence[complex] = (), segments: Sequence[tuple[complex, complex]] = ()
) -> None:
    """Write the labels, the first ones best placed; they keep clear of each other's places and of the marks, m."""
    anchors = to_points(axes, [label.at for label in labels])
    lines = [to_points(axes, begin + (end - begin) * _SAMPLES) for begin, end in segments]
    points = np.concatenate([anchors, to_points(axes, marks)])
    crowd = np.concatenate([points, *lines])
    weights = np.where(np.arange(crowd.size) < points.size, _MARK_WEIGHT, 1.0)
    taken: list[tuple[complex, complex]] = []
    for label, anchor in zip(labels, anchors.tolist(), strict=True):
        half = _LABEL_PT * complex(0.36 * len(label.text), 0.55)
        offsets = _offsets(half)
        cost = _covers(anchor + offsets, half + 2.0 + 2.0j, crowd) @ weights
        cost += _GAP_WEIGHT * np.repeat(_GAPS_PT, _DIRECTIONS.size)
        cost += _EDGE_WEIGHT * _outside(axes, anchor + offsets, half)
        for centre, other in taken:
            cost += _LABEL_WEIGHT * _covers(anchor + offsets, half + other, np.array([centre]))[:, 0]
        offset = complex(offsets[np.argmin(cost)])
        taken.append((anchor + offset, half))
        _write(axes, label, offset)


def _write(axes: Axes, label: Label, offset: complex) -> None:
    text = axes.annotate(
        label.text,
        (label.at.real, label.at.imag),
        (offset.real, offset.imag),
        textcoords="offset points",
        horizontalalignment="center",
        verticalalignment="center",
        fontsize=_LABEL_PT,
        fontweight="bold" if label.bold else "normal",
    )
    text.set(parse_math=False, zorder=7, gid=label.gid)
    text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _offsets(half: complex) -> Points:
    """Return where the middle of a label of this half size may lie about its place, nearest first, points."""
    return np.concatenate(
        [_DIRECTIONS.real * (half.real + gap) + 1j * _DIRECTIONS.imag * (half.imag + gap) for gap in _GAPS_PT]
    )


def _covers(centres: Points, half: complex, points: Points) -> NDArray[np.float64]:
    """Return 1 where the box about a centre (row) covers a point (column), else 0."""
    apart = points[None, :] - centres[:, None]
    return np.where((np.abs(apart.real) < half.real) & (np.abs(apart.imag) < half.imag), 1.0, 0.0)


def _outside(axes: Axes, centres: Points, half: complex) -> NDArray[np.float64]:
    """Return 1 where the box about a centre sticks out of the axes, else 0."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    low, high = to_points(axes, [complex(left, bottom), complex(right, top)])
    inside = (centres.real - half.real > low.real) & (centres.real + half.real < high.real)
    inside &= (centres.imag - half.imag > low.imag) & (centres.imag + half.imag < high.imag)
    return np.where(inside, 0.0, 1.0)
