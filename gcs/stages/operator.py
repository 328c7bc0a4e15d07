"""The operator of a run: what he is asked, what he says over the bus or at the terminal, and that he may stop it."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.messages import ControlReply, ControlRequest, MalformedMessageError, decode, encode
from gcs.control import STOPPED, TAKEOVER, ControlDesk

Terminal = Callable[[], Awaitable[bool]]
"""Waits for a word at the terminal: True to go on, False to stop."""

WAYS_ON: Final = "bearing-relay control resume, or abort"


@dataclass
class Operator:
    """Whoever attends a run, or nobody. `say` puts what is said before whoever watches."""

    say: Callable[[str], None]
    attended: bool = False
    terminal: Terminal | None = None
    desk: ControlDesk | None = None
    """Who answers for the relay, once it is flown."""
    stopped: str | None = None
    """Why the run is to end, or None."""
    take_over: Callable[[str], ControlReply] | None = None
    """Gives on the vehicles of a lost link node, where there are nodes."""
    show: Callable[[str | None], None] = lambda _: None
    """Gets what he is asked, and None when that is no longer asked."""
    _asked: asyncio.Future[bool] | None = None
    _stopping: asyncio.Event = field(default_factory=asyncio.Event)

    def stop(self, reason: str) -> None:
        """End the run, as soon as every vehicle holds."""
        if self.stopped is None:
            self.stopped = reason
            self.say(f"{reason}: every vehicle holds")
        self._stopping.set()

    async def until_stopped(self) -> None:
        """Return when the run is to end."""
        await self._stopping.wait()

    async def goes_on(self, question: str) -> bool:
        """Ask whether to go on, and return what he says; nobody attending, nobody is asked."""
        if not self.attended:
            return False
        here = "" if self.terminal is None else "; here, Enter goes on"
        self.say(f"{question} ({WAYS_ON}{here})")
        self.show(question)
        self._asked = asyncio.get_running_loop().create_future()
        reading = None if self.terminal is None else asyncio.ensure_future(self.terminal())
        try:
            await asyncio.wait(filter(None, (self._asked, reading)), return_when=asyncio.FIRST_COMPLETED)
            if self._asked.done():
                return self._asked.result()
            return reading is not None and reading.result()
        finally:
            self._asked = None
            self.show(None)
            if reading is not None:
                reading.cancel()

    def answer(self, payload: bytes) -> bytes:
        """Return the ControlReply to a ControlRequest, both as they are on the bus."""
        try:
            request = decode(payload, ControlRequest)
        except MalformedMessageError as error:
            return encode(ControlReply(ok=False, message=f"no control request: {error}"))
        if request.verb == TAKEOVER:
            return self._said(request, self._taken_over(request))
        if self._asked is None and self.desk is not None and not self.desk.relay.ended:
            reply = self.desk.answer(payload)
            if request.verb == "abort" and decode(reply, ControlReply).ok:
                self.stop(STOPPED)
            return reply
        return self._said(request, self._about_the_run(request))

    def _said(self, request: ControlRequest, answer: ControlReply) -> bytes:
        self.say(f"operator: {' '.join(filter(None, (request.verb, request.vehicle)))}: {answer.message}")
        return encode(answer)

    def _taken_over(self, request: ControlRequest) -> ControlReply:
        if self.take_over is None or request.vehicle is None:
            why = "takeover names a link node" if request.vehicle is None else "this run has no link nodes"
            return ControlReply(ok=False, message=why)
        return self.take_over(request.vehicle)

    def _about_the_run(self, request: ControlRequest) -> ControlReply:
        if request.verb == "abort" and request.vehicle is None:
            self.stop(STOPPED)
            return ControlReply(ok=True, message="the run ends; every vehicle holds")
        if self._asked is None:
            return ControlReply(ok=False, message="no relay is being flown, and nothing is asked: abort ends the run")
        if request.verb != "resume" or request.vehicle is not None:
            return ControlReply(ok=False, message="the run waits: resume goes on, abort ends it")
        if not self._asked.done():
            self._asked.set_result(True)
        return ControlReply(ok=True, message="the run goes on")


@contextlib.contextmanager
def stopping_on_interrupt(operator: Operator) -> Iterator[None]:
    """Let Ctrl-C hold every vehicle and end the run in order."""
    loop = asyncio.get_running_loop()
    for signal_number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(signal_number, operator.stop, STOPPED)
    try:
        yield
    finally:
        for signal_number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(signal_number)
