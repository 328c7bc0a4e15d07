"""Separation: how near two vehicles come to each other if both brake from now on, and who is kept from whom for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

_BRAKES_MPS2: Final = 2.5
_ANSWERS_S: Final = 1.0
"""A copter that is told to stop comes to rest after v^2 / 2a + 0.4 v; the rest is sway, and how old what it told is.

A leg's speed near its end is such that its end is not run over by this either: as planned, nobody is stopped by it.
"""
_APART_AGAIN_M: Final = 0.5


def braking_way(velocity: complex) -> complex:
    """Return the way a vehicle comes that is told to stop now, m, from its velocity, m/s; same axes."""
    return velocity * (_ANSWERS_S + abs(velocity) / (2.0 * _BRAKES_MPS2))


def nearest_m(apart: complex, closing: complex) -> float:
    """Return the smallest distance, m, of two who are `apart` while one moves by `closing` against the other."""
    if closing == 0j:
        return abs(apart)
    share = -(apart * closing.conjugate()).real / abs(closing) ** 2
    return abs(apart + closing * min(max(share, 0.0), 1.0))


@dataclass
class _Kept:
    other: str
    since_s: float
    nearest_m: float


@dataclass
class Keeping:
    """Who is kept from whom. Stopped in time, one is not too near any more, and yet it must not fly on there at once.

    It is kept until the two have moved apart, or for so long that its leg has been given up.
    """

    longest_s: float
    _kept: dict[str, _Kept] = field(default_factory=dict)

    def note(self, name: str, other: str, time_s: float, apart_m: float) -> None:
        """Note that a vehicle has come too near another, or would come."""
        self._kept[name] = _Kept(other, time_s, apart_m)

    def still_from(self, name: str, time_s: float, apart_m: Callable[[str], float]) -> str | None:
        """Return whom a vehicle is kept from though it is no danger now, or None; `apart_m` is its distance to one."""
        kept = self._kept.get(name)
        if kept is None:
            return None
        now_m = apart_m(kept.other)
        if now_m > kept.nearest_m + _APART_AGAIN_M or time_s - kept.since_s > self.longest_s:
            del self._kept[name]
            return None
        kept.nearest_m = min(now_m, kept.nearest_m)
        return kept.other
