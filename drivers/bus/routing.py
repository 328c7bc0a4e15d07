"""A bus router as it is run by itself: it routes, and on a closed bus it counts and tells what it refuses."""

from __future__ import annotations

import asyncio
import math
import secrets
import sys
import time
from pathlib import Path
from typing import Final

from drivers.bus.log_tap import zenoh_log
from drivers.bus.refusal_log import LOG_FILTER, Tally
from drivers.bus.refusals import encode_refusals, refusals_key
from drivers.bus.security import KeyedEndpoint, with_keys
from drivers.bus.session import BusEndpoint, LiveBus, open_bus
from drivers.process import until_told_to_stop
from drivers.tasks import background

TOLD_EVERY_S: Final = 1.0
SAID_EVERY_S: Final = 10.0
UNHEARD_LOOKS: Final = 5
"""So often nothing of the log need have come when a router has just begun."""


async def route(endpoint: BusEndpoint, keys: Path | None, parent_pid: int | None) -> None:
    """Route until told to stop, or until the parent process has ended. BusError when it cannot be listened there."""
    at = with_keys(endpoint, keys)
    if not isinstance(at, KeyedEndpoint):
        async with open_bus(at):
            await until_told_to_stop(parent_pid)
        return
    tally = Tally(at.parties)
    with zenoh_log(LOG_FILTER, tally.take):
        async with open_bus(at) as bus, background(_tell(bus, at.swarm, tally)):
            await until_told_to_stop(parent_pid)


async def _tell(bus: LiveBus, swarm: str | None, tally: Tally) -> None:
    """Tell the bus what was refused, once a second, and this process's screen when it has grown, until cancelled."""
    key = None if swarm is None else refusals_key(swarm, secrets.token_hex(4))
    screen = Screen(tally)
    try:
        while True:
            if key is not None:
                bus.put_latest(key, encode_refusals(tally.refusals))
            screen.show(time.monotonic())
            await asyncio.sleep(TOLD_EVERY_S)
    finally:
        screen.show(math.inf)


class Screen:
    """Says what was refused on the standard error, whenever it has grown, but not too often."""

    def __init__(self, tally: Tally) -> None:
        self._tally = tally
        self._said = 0
        self._again_s = -math.inf
        self._looks = 0
        self._doubted = False

    def show(self, now_s: float) -> None:
        """Say what there is to say, at a time of any clock, s."""
        refusals = self._tally.refusals
        if refusals.total > self._said and now_s >= self._again_s:
            self._said, self._again_s = refusals.total, now_s + SAID_EVERY_S
            _say(str(refusals))
        self._looks += 1
        unheard = self._looks > UNHEARD_LOOKS and not self._tally.begun
        if (unheard or self._tally.not_understood) and not self._doubted:
            self._doubted = True
            _say("zenoh's log is not understood here: not everything that is refused may be counted")


def _say(text: str) -> None:
    sys.stderr.write(f"{time.strftime('%H:%M:%S')} {text}\n")
    sys.stderr.flush()
