"""Which command an acknowledgement answers.

COMMAND_ACK names only the number of a command. An answer that comes after its time-out must not answer the next
command of the same number: while one may still be under way, that number is not free.
"""

from __future__ import annotations

import asyncio
from typing import Final

from drivers.clock import Clock

LATE_ANSWER_S: Final = 30.0
"""How late an answer is still reckoned with."""


class Acknowledgements:
    """The answers one vehicle owes."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._awaited: dict[int, asyncio.Future[int]] = {}
        self._owed_until_s: dict[int, float] = {}

    def is_free(self, command: int) -> bool:
        """Return whether the next answer to a command of this number could only be to one sent now."""
        return command not in self._awaited and self._clock.now_s() >= self._owed_until_s.get(command, 0.0)

    def expect(self, command: int) -> asyncio.Future[int]:
        """Return what the answer to a command sent now, its number being free, will set: its MAV_RESULT."""
        answer: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self._awaited[command] = answer
        return answer

    def stop_waiting(self, command: int) -> None:
        """End the wait for an answer; one that has not come may still come."""
        answer = self._awaited.pop(command, None)
        if answer is not None and not answer.done():
            self.expect_unheeded(command)

    def expect_unheeded(self, command: int) -> None:
        """Reckon with an answer that nobody waits for."""
        self._owed_until_s[command] = self._clock.now_s() + LATE_ANSWER_S

    def take(self, command: int, result: int) -> None:
        """Give an answer to whoever waits for it."""
        answer = self._awaited.get(command)
        if answer is None:
            self._owed_until_s.pop(command, None)
        elif not answer.done():
            answer.set_result(result)
