"""Doing the same with many vehicles at once: one that fails keeps no other from being finished."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterable
from typing import Any


async def all_of(coroutines: Iterable[Coroutine[Any, Any, None]]) -> None:
    """Run coroutines side by side until each has ended; their failures are raised together, in a group."""
    tasks = [asyncio.ensure_future(coroutine) for coroutine in coroutines]
    try:
        if tasks:
            await asyncio.wait(tasks)
    finally:
        for task in tasks:
            task.cancel()
    failures = [failure for task in tasks if (failure := task.exception()) is not None]
    if failures:
        raise BaseExceptionGroup("of several", failures)
