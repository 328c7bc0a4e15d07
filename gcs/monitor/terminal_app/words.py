"""Numbers and states as the terminal writes them: with units, and never by colour alone."""

from __future__ import annotations

import math
from typing import Final

from drivers.bus.run_messages import Level

STATE_STYLES: Final = {
    "WAITING": "dim",
    "PLACED": "green",
    "HELD": "bold red",
    "PILOT": "bold magenta",
    "FAILED": "bold red",
}
FLYING_STYLE: Final = "bold cyan"
LEVEL_STYLES: Final[dict[Level, str]] = {"alert": "bold white on red", "warning": "bold black on yellow", "info": ""}
LEVEL_WORDS: Final[dict[Level, str]] = {"alert": "ALERT", "warning": "warn", "info": ""}
NOTHING: Final = "–"


def state_style(state: str) -> str:
    """Return the style of a receiver's state."""
    return STATE_STYLES.get(state, FLYING_STYLE)


def degrees(angle_rad: float | None, *, signed: bool = False, digits: int = 2) -> str:
    """Return an angle in degrees."""
    if angle_rad is None:
        return NOTHING
    return f"{math.degrees(angle_rad):{'+' if signed else ''}.{digits}f}"


def number(value: float | None, unit: str = "", digits: int = 1) -> str:
    """Return a number with its unit."""
    return NOTHING if value is None else f"{value:.{digits}f}{unit and ' '}{unit}"


def duration(time_s: float | None) -> str:
    """Return a duration as minutes and seconds."""
    if time_s is None:
        return NOTHING
    minutes, seconds = divmod(round(max(time_s, 0.0)), 60)
    return f"{minutes}:{seconds:02d}"
