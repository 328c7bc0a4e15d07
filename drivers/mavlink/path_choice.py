"""Which of several links to a vehicle to speak on: the first in order of preference on which it is heard.

A link that falls silent is left soon, and returned to late.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from drivers.mavlink.link import Channel

SILENT_S: Final = 0.25
"""Positions come 5 to 10 times a second: a link silent for longer is left for one that is heard steadily."""
STEADY_S: Final = 1.0
"""A link is heard steadily when it has not been silent for SILENT_S in this time."""
PATIENCE_S: Final = 1.5
"""A link silent for longer is left for one that is heard at all: with heartbeats alone a second is no silence."""
RETURN_AFTER_S: Final = 5.0
"""A preferred link is returned to when it has been steady for this long."""


@dataclass(eq=False)
class Path:
    """One link, by its place in the order of preference, and how well one vehicle is heard on it."""

    number: int
    link: Channel
    heard_s: float = -math.inf
    _unbroken_since_s: float = math.inf
    """Since when it has not been silent for SILENT_S."""
    _alive_since_s: float = math.inf
    """Since when it has not been silent for PATIENCE_S."""
    _steady_s: float = -math.inf
    """When it was steady last."""

    def hear(self, now_s: float) -> None:
        """Take note that the vehicle is heard, and not late."""
        silent_s, self.heard_s = now_s - self.heard_s, now_s
        if silent_s > SILENT_S:
            self._unbroken_since_s = now_s
        elif now_s - self._unbroken_since_s >= STEADY_S:
            self._steady_s = now_s
        if silent_s > PATIENCE_S:
            self._alive_since_s = now_s

    def is_steady(self, now_s: float, for_s: float) -> bool:
        """Return whether it has not been silent for SILENT_S in this time."""
        return now_s - self.heard_s <= SILENT_S and now_s - self._unbroken_since_s >= for_s

    def is_alive(self, now_s: float, for_s: float) -> bool:
        """Return whether it has not been silent for PATIENCE_S in this time."""
        return now_s - self.heard_s <= PATIENCE_S and now_s - self._alive_since_s >= for_s

    def was_steady(self, now_s: float, within_s: float) -> bool:
        """Return whether it was steady at any moment of this time."""
        return now_s - self._steady_s <= within_s


def better_path(paths: Sequence[Path], used: Path, now_s: float) -> Path | None:
    """Return the path to change to, or None to stay. `paths` are in order of preference."""
    return _preferred(paths, used, now_s) or _fallback(paths, used, now_s)


def _preferred(paths: Sequence[Path], used: Path, now_s: float) -> Path | None:
    """Return the path to go back to: steady for a while, or as good as the one in use, which is not steady either."""
    rough = not used.was_steady(now_s, RETURN_AFTER_S)
    for path in paths[: used.number]:
        if path.is_steady(now_s, RETURN_AFTER_S) or (rough and path.is_alive(now_s, RETURN_AFTER_S)):
            return path
    return None


def _fallback(paths: Sequence[Path], used: Path, now_s: float) -> Path | None:
    """Return the path to use instead of one that has fallen silent."""
    silent_s = now_s - used.heard_s
    if silent_s <= SILENT_S:
        return None
    others = [path for path in paths if path is not used]
    steady = [path for path in others if path.is_steady(now_s, STEADY_S)]
    alive = [path for path in others if path.is_alive(now_s, 0.0)] if silent_s > PATIENCE_S else []
    return next(iter((*steady, *alive)), None)
