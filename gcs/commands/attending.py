"""The word of an operator who sits at the terminal that a run was started from."""

from __future__ import annotations

import asyncio
import sys
from typing import Final

_GOING_ON: Final = ("", "y", "yes")


async def enter_pressed() -> bool:
    """Wait for a line at the terminal; an empty one, or a yes, means to go on. At its end nobody is there."""
    loop = asyncio.get_running_loop()
    typed: asyncio.Future[str] = loop.create_future()

    def read() -> None:
        line = sys.stdin.readline()
        if not typed.done():
            typed.set_result(line)

    loop.add_reader(sys.stdin, read)
    try:
        line = await typed
    finally:
        loop.remove_reader(sys.stdin)
    return line.endswith("\n") and line.strip().casefold() in _GOING_ON
