"""ArduCopter's flight modes: numbers, names and which of them a station may arm or enter."""

from __future__ import annotations

from enum import IntEnum


class Mode(IntEnum):
    """HEARTBEAT.custom_mode of the modes flown here."""

    STABILIZE = 0
    ALT_HOLD = 2
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    BRAKE = 17


AUTO = 3  # known, and refused: there is never a mission to fly

ARMABLE = frozenset({Mode.STABILIZE, Mode.ALT_HOLD, Mode.GUIDED, Mode.LOITER})

PILOTED = frozenset({Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER})
"""Modes flown by sticks: the ground-station failsafe leaves them to the pilot."""
