"""How the helper processes (router, sensors) live and end."""

from __future__ import annotations

import asyncio
import os
import signal

_PARENT_CHECK_S = 0.5


async def until_told_to_stop(parent_pid: int | None = None) -> None:
    """Return at SIGTERM or SIGINT, or soon after the process `parent_pid` has ended."""
    stopped = asyncio.Event()
    loop = asyncio.get_running_loop()
    for signal_number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(signal_number, stopped.set)
    while not stopped.is_set() and (parent_pid is None or os.getppid() == parent_pid):
        try:
            await asyncio.wait_for(stopped.wait(), _PARENT_CHECK_S)
        except TimeoutError:
            continue
