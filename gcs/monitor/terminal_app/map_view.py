"""The formation from above, in characters: who stands and flies where, to one scale on both axes."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field

from rich.text import Text

from drivers.bus.run_messages import Place, RunSetup, RunState, VehicleState

_CELL_ASPECT = 2.0
"""A character is so many times as high as wide."""
_LABEL = 4
"""Columns kept for the name of what stands at the right edge."""
_ARROWS = "→↗↑↖←↙↓↘"
_HOVERING_MPS = 0.5
_STATE_MARKS = {"HELD": "bold red", "PILOT": "bold magenta", "FAILED": "bold red", "PLACED": "green"}


@dataclass
class Canvas:
    """Characters over a part of the plane: `turn` rotates it, `low` and `high` are the corners after that, m."""

    columns: int
    rows: int
    turn: complex
    low: complex
    high: complex
    _cells: dict[tuple[int, int], tuple[str, str]] = field(default_factory=dict, init=False)

    @property
    def metres_per_column(self) -> float:
        """The scale."""
        width_m, height_m = (self.high - self.low).real, (self.high - self.low).imag
        columns, rows = max(self.columns - 1 - _LABEL, 1), max(self.rows - 1, 1)
        return max(width_m / columns, height_m / rows / _CELL_ASPECT, 1e-3)

    def put(self, at: complex, text: str, style: str = "") -> None:
        """Write at a place, unless it is outside; what is written later covers what was there."""
        turned, scale = at * self.turn - (self.low + self.high) / 2.0, self.metres_per_column
        column = round((self.columns - _LABEL) / 2.0 + turned.real / scale)
        row = round(self.rows / 2.0 - turned.imag / scale / _CELL_ASPECT)
        for offset, character in enumerate(text):
            if 0 <= column + offset < self.columns and 0 <= row < self.rows:
                self._cells[row, column + offset] = (character, style)

    def line(self, start: complex, end: complex, mark: str, style: str) -> None:
        """Draw a line."""
        steps = max(int(abs(end - start) / (2.0 * self.metres_per_column)), 1)
        for step in range(steps + 1):
            self.put(start + (end - start) * step / steps, mark, style)

    def text(self) -> Text:
        """Return what was drawn."""
        lines = list[Text]()
        for row in range(self.rows):
            cells = (self._cells.get((row, column), (" ", "")) for column in range(self.columns))
            lines.append(Text.assemble(*cells))
        return Text("\n").join(lines)


def formation_map(
    state: RunState, setup: RunSetup, tracks: dict[str, list[Place]], columns: int, rows: int, *, north_up: bool
) -> Text:
    """Return the formation from above: `o` slots, `*` transmitters on the air, arrows who flies, `x` planned turns.

    Up is north, or the left of the formation's axis. Circles of a few metres around vehicles would be smaller than a
    character: instead the last line but one says which two are closest, beside how far apart they are kept.
    """
    turn = cmath.exp(1j * (math.pi / 2.0 - setup.axis_azimuth_rad)) if north_up else 1 + 0j
    canvas = _canvas(setup, state, turn, columns, rows - 2)
    for corner, following in zip(setup.fence, [*setup.fence[1:], *setup.fence[:1]], strict=True):
        canvas.line(complex(*corner), complex(*following), "#", "dim")
    for route in setup.routes:
        for leg in route.legs[:-1]:
            canvas.put(complex(*leg.end_m), "x", "dim")
    for track in tracks.values():
        for point in track:
            canvas.put(complex(*point), ".", "dim cyan")
    for receiver in state.receivers:
        if receiver.leg is not None:
            canvas.line(complex(*receiver.leg.start_m), complex(*receiver.leg.end_m), "-", "cyan")
    for slot, at in setup.slots.items():
        canvas.put(complex(*at), f"o{slot}", "dim")
    states = {receiver.name: receiver.state for receiver in state.receivers}
    known = {vehicle.name: vehicle.at_m for vehicle in state.vehicles}
    fixed = {transmitter.name: transmitter.at_m for transmitter in setup.transmitters}
    moving = {vehicle.name: _arrow(vehicle, turn) for vehicle in state.vehicles}
    for name, at_m in {**fixed, **{name: at_m for name, at_m in known.items() if at_m is not None}}.items():
        mark = "*" if name in state.on_air else moving.get(name) or "+"
        canvas.put(complex(*at_m), f"{mark}{name}", _STATE_MARKS.get(states.get(name, ""), "bold"))
    up = "north up" if north_up else "formation up"
    legend = (
        f"{up} (n turns), a column is {canvas.metres_per_column:.1f} m: * on the air  + silent  o slot  x turn  . track"
    )
    return Text.assemble(canvas.text(), "\n", _closest(state, setup)[:columns], "\n", (legend[:columns], "dim"))


def _closest(state: RunState, setup: RunSetup) -> str:
    """Return which two vehicles are closest to each other, and how far apart they are kept."""
    distances = [(each.nearest_m, each.name, each.nearest) for each in state.vehicles if each.nearest_m is not None]
    closest = "nobody yet" if not distances else "{1} and {2} {0:.1f} m".format(*min(distances))
    return f"closest: {closest}; they are kept {setup.min_separation_m:g} m apart"


def _arrow(vehicle: VehicleState, turn: complex) -> str:
    """Return where a vehicle flies; nothing for one that hovers."""
    velocity = complex(*(vehicle.velocity_mps or (0.0, 0.0))) * turn
    if abs(velocity) < _HOVERING_MPS:
        return ""
    return _ARROWS[round(cmath.phase(velocity) / (math.pi / 4.0)) % len(_ARROWS)]


def _canvas(setup: RunSetup, state: RunState, turn: complex, columns: int, rows: int) -> Canvas:
    places = [
        *setup.slots.values(),
        *(transmitter.at_m for transmitter in setup.transmitters),
        *(route.start_m for route in setup.routes),
        *(leg.end_m for route in setup.routes for leg in route.legs),
        *setup.fence,
        *(vehicle.at_m for vehicle in state.vehicles if vehicle.at_m is not None),
    ]
    turned = [complex(*at) * turn for at in places]
    xs, ys = [at.real for at in turned], [at.imag for at in turned]
    return Canvas(columns, max(rows, 1), turn, complex(min(xs), min(ys)), complex(max(xs), max(ys)))
