"""The subtended angle of one leg over time, in characters, with its stop angle."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.text import Text

from gcs.monitor.history import AngleSample


def angle_chart(samples: Sequence[AngleSample], columns: int, rows: int) -> Text:
    """Return the angle of the latest leg in the samples, degrees, and its stop angle as a line."""
    if not samples:
        return Text("no angle yet", style="dim")
    leg = [sample for sample in samples if sample.leg == samples[-1].leg]
    leg = leg[-_since_gap(leg) :]
    values = [sample.angle_rad for sample in leg]
    stop_rad = leg[-1].stop_angle_rad
    low, high = min(*values, stop_rad), max(*values, stop_rad)
    span = max(high - low, math.radians(0.5))
    label = 8
    width, height = max(columns - label, 2), max(rows, 2)
    grid = [[" "] * width for _ in range(height)]

    def row_of(angle_rad: float) -> int:
        return min(height - 1, max(0, round((high - angle_rad) / span * (height - 1))))

    stop_row = row_of(stop_rad)
    grid[stop_row] = ["-"] * width
    first_s, last_s = leg[0].elapsed_s, leg[-1].elapsed_s
    for sample in leg:
        share = min(max((sample.elapsed_s - first_s) / max(last_s - first_s, 1e-3), 0.0), 1.0)
        grid[row_of(sample.angle_rad)][round(share * (width - 1))] = "o"
    labels = {0: math.degrees(high), height - 1: math.degrees(high - span), stop_row: math.degrees(stop_rad)}
    lines = [
        Text.assemble(
            (f"{labels[row]:7.2f} " if row in labels else " " * label, "yellow" if row == stop_row else "dim"),
            ("".join(cells), "yellow" if row == stop_row else "cyan"),
        )
        for row, cells in enumerate(grid)
    ]
    return Text("\n").join(lines)


def _since_gap(samples: Sequence[AngleSample]) -> int:
    """Return how many of the last samples are of one flight: between two, more time passes than between states."""
    for back in range(1, len(samples)):
        if samples[-back].elapsed_s - samples[-back - 1].elapsed_s > 5.0:
            return back
    return len(samples)
