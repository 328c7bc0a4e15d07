"""Redraws the paper's figures 9 and 10: the cases of table 2, and the paths of the eight UAVs by every strategy.

In the SVG of figure 9 the group ids are `triangle`, `transmitter-A`, `target-O`, `case-Inside` and `sight-A-Inside`, in
that of figure 10 d `descent-U1` and `steps-U1` beside those of a plan; labels have `label-` before.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from matplotlib.lines import Line2D

from gcs.errors import ServiceError
from gcs.paper.chain import TRANSMITTERS, Task, one_model_plan, problem, tasks
from gcs.paper.places import point, receiver, triangle
from gcs.paper.printed import PRINTED, Positioning
from gcs.reports.canvas import (
    SLOT,
    START,
    TRANSMITTER,
    Extent,
    Style,
    add_legend,
    extent_of,
    line,
    mark,
    new_sheet,
    save,
)
from gcs.reports.figure import draw_plan
from gcs.reports.labels import Label, draw_labels
from planner.baselines import Descent
from planner.methods import METHODS
from planner.plan import RelayPlan

_TRIANGLE: Style = {"color": "#000000", "linewidth": 1.2}
_SIGHT: Style = {"color": "#888888", "linestyle": (0, (1, 3)), "linewidth": 0.7}
_CASE: Style = {"marker": "o", "markersize": 7, "markerfacecolor": "#56B4E9", "markeredgecolor": "#000000"}
_TARGET: Style = {"marker": "*", "markersize": 13, "markerfacecolor": "#D55E00", "markeredgecolor": "#000000"}
_DESCENT: Style = {"color": "#009E73", "linewidth": 1.4}
_STEP: Style = {"marker": "o", "markersize": 3.2, "markerfacecolor": "#FFFFFF", "markeredgecolor": "#009E73"}

_Descents = Sequence[tuple[Task, Descent]]


def draw_paper_figures(folder: Path) -> list[Path]:
    """Write figures 9 and 10 a to d as SVG into a folder, made if there is none; return their paths.

    The four of figure 10 share their axes. Raises ServiceError when the folder or a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ServiceError(f"{folder}: the folder cannot be made: {error.strerror or error}") from error
    table = PRINTED.table_3
    plans = {
        "a, model I": one_model_plan(table, 0),
        "b, model II": one_model_plan(table, 1),
        "c, two-step strategy": METHODS["paper"](problem(table, 0.0)),
    }
    descents = [(task, task.descent()) for task in tasks(table)]
    extent = extent_of(_paths(plans.values(), descents))
    paths = [folder / f"figure_{number}.svg" for number in ("9", "10a", "10b", "10c", "10d")]
    _draw_positions(PRINTED.table_2, paths[0])
    for path, (name, plan) in zip(paths[1:4], plans.items(), strict=True):
        draw_plan(plan, TRANSMITTERS, path, title=f"Figure 10 {name}", extent=extent)
    _draw_descents(descents, paths[4], extent)
    return paths


def _paths(plans: Iterable[RelayPlan], descents: _Descents) -> Iterable[complex]:
    """Yield every point of figure 10."""
    yield from TRANSMITTERS.values()
    for plan in plans:
        for route in plan.routes:
            yield from (route.start, *(leg.end for leg in route.legs))
    for _, descent in descents:
        yield from descent.places


def _draw_positions(setting: Positioning, path: Path) -> None:
    """Draw the triangle ABC, the target O and the seven places of the receiver D of table 2."""
    corners = dict(zip("ABC", triangle(setting), strict=True))
    cases = {case.name: receiver(setting, case) for case in setting.cases}
    target = point(setting.target)
    extent = extent_of([*corners.values(), *cases.values()], margin=0.1)
    figure, axes = new_sheet(path, extent, "Figure 9, the places of D about the triangle ABC")
    axes.set(xlabel="x, from A to B (units)", ylabel="y (units)")
    line(axes, [*corners.values(), corners["A"]], gid="triangle", zorder=2, **_TRIANGLE)
    for case, at in cases.items():
        for corner, place in corners.items():
            line(axes, [at, place], gid=f"sight-{corner}-{case}", zorder=1, **_SIGHT)
        mark(axes, at, gid=f"case-{case}", zorder=6, **_CASE)
    for corner, place in corners.items():
        mark(axes, place, gid=f"transmitter-{corner}", zorder=6, **TRANSMITTER)
    mark(axes, target, gid="target-O", zorder=6, **_TARGET)
    named = {"receiver D": _CASE, "transmitter": TRANSMITTER, "target O": _TARGET}
    marks = [Line2D([], [], label=name, linestyle="none", **style) for name, style in named.items()]
    add_legend(figure, [*marks, Line2D([], [], label="direction measured", **_SIGHT)])
    labels = [
        *(Label(f"label-transmitter-{corner}", corner, place) for corner, place in corners.items()),
        Label("label-target-O", "O", target),
        *(Label(f"label-case-{case}", case, at, bold=False) for case, at in cases.items()),
    ]
    sides = list(zip(corners.values(), [*list(corners.values())[1:], corners["A"]], strict=True))
    draw_labels(axes, labels, segments=[*sides, *((at, place) for at in cases.values() for place in corners.values())])
    save(figure, path)


def _draw_descents(descents: _Descents, path: Path, extent: Extent) -> None:
    """Draw the paths of the geometric optimisation as reconstructed."""
    total_m = sum(descent.length_m for _, descent in descents)
    title = f"Figure 10 d, geometric optimisation (reconstructed): total length {total_m:.2f} m"
    figure, axes = new_sheet(path, extent, title)
    labels = [Label(f"label-transmitter-{name}", name, at) for name, at in TRANSMITTERS.items()]
    for name, at in TRANSMITTERS.items():
        mark(axes, at, gid=f"transmitter-{name}", zorder=6, **TRANSMITTER)
    for number, (task, descent) in enumerate(descents, 1):
        name, slot = task.receiver, f"O{number}"
        line(axes, descent.places, gid=f"descent-{name}", zorder=3, **_DESCENT)
        line(axes, descent.places[1:-1], gid=f"steps-{name}", zorder=4, linestyle="none", **_STEP)
        mark(axes, task.target, gid=f"slot-{slot}", zorder=6, **SLOT)
        mark(axes, task.start, gid=f"start-{name}", zorder=5, **START)
        labels += [
            Label(f"label-slot-{slot}", slot, task.target),
            Label(f"label-start-{name}", name, task.start, bold=False),
        ]
    named = {"transmitter": TRANSMITTER, "slot": SLOT, "start": START, "end of a step": _STEP}
    marks = [Line2D([], [], label=name, linestyle="none", **style) for name, style in named.items()]
    add_legend(figure, [Line2D([], [], label="gradient descent", **_DESCENT), *marks])
    moves = [move for _, descent in descents for move in zip(descent.places, descent.places[1:], strict=False)]
    draw_labels(axes, labels, segments=moves)
    save(figure, path)
