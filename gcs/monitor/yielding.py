"""Screens on the machine that flies give way to the flight."""

from __future__ import annotations

import contextlib
import os
from typing import Final

NICENESS: Final = 10


def give_way() -> None:
    """Let every other process go first from now on, as far as the system has such a thing."""
    with contextlib.suppress(OSError, AttributeError):
        os.nice(NICENESS)
