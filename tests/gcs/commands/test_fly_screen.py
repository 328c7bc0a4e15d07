"""What shows a run never ends it."""

from __future__ import annotations

import asyncio
import io

import pytest
from rich.console import Console

from drivers.clock import SystemClock
from gcs.commands.fly import shown_on
from gcs.status import RunStatus


class Broken(io.StringIO):
    """A screen that takes nothing."""

    def __init__(self, failure: BaseException) -> None:
        super().__init__()
        self.failure = failure
        self.asked = 0

    def write(self, _text: str) -> int:
        self.asked += 1
        raise self.failure


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), SystemExit(1)])
@pytest.mark.parametrize("terminal", [False, True])
async def test_a_screen_that_takes_nothing_does_not_end_the_flight(failure: BaseException, terminal: bool) -> None:
    screen = Broken(failure)
    status = RunStatus("field", SystemClock())
    status.say("U1 LEG_1")
    flown = False
    console = Console(file=screen, force_terminal=terminal)
    async with asyncio.timeout(20.0), shown_on(console)(status):
        while not screen.asked:  # noqa: ASYNC110 - what shows a run tells nobody
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.01)
        flown = True
    assert flown
    console.print("and after it")
