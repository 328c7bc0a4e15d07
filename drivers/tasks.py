"""Background tasks bound to a block: they end with it, and their failure ends it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any

StartTask = Callable[[Coroutine[Any, Any, None]], None]


@contextlib.asynccontextmanager
async def open_background() -> AsyncIterator[StartTask]:
    """Yield what starts a coroutine beside the body; a failing one cancels the body and is raised from it."""
    async with asyncio.TaskGroup() as group:
        tasks: list[asyncio.Task[None]] = []
        try:
            yield lambda coroutine: tasks.append(group.create_task(coroutine))
        finally:
            for task in tasks:
                task.cancel()


@contextlib.asynccontextmanager
async def background(*coroutines: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    """Run coroutines beside the body; a failing one cancels the body and is raised from it."""
    async with open_background() as start:
        for coroutine in coroutines:
            start(coroutine)
        yield
