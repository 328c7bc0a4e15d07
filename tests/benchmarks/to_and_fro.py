"""A service that flies its vehicles on short legs, to and fro, as a relay flies a leg: what ends each is told."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import sys
import tempfile
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from gcs.bearings import Observation, Observations
from gcs.errors import HoldRequiredError
from gcs.recording.flight import open_recording
from gcs.stop_monitor import TURN
from gcs.traced_monitor import Trace, TracedMonitor, untraced
from tests.benchmarks.answering import Station
from tests.benchmarks.swarm import KEYS, TRANSMITTERS, leg_between, start_of

SETTLING_S: Final = 4.0
"""Within so long all of them have begun their first leg: they do not all stop at once."""
_LEG_M: Final = 8.0
_RESTS_S: Final = 1.0
_NEAR: Final = np.eye(2) * 0.5**2
_ANYWHERE: Final = np.eye(2) * 5.0**2


@dataclass
class Noted:
    """A receiver's observations, of which the last one taken is remembered."""

    observations: Observations
    captured_s: float = 0.0

    async def next(self, timeout_s: float) -> Observation | None:
        taken = await self.observations.next(timeout_s)
        if taken is not None:
            self.captured_s = taken.captured_s
        return taken


@contextlib.asynccontextmanager
async def recording_of(station: Station, *, recorded: bool) -> AsyncIterator[Trace]:
    """Record what is said in the swarm into a folder that is thrown away; yield what records stop monitors, too."""
    if not recorded:
        yield untraced
        return
    with tempfile.TemporaryDirectory() as folder:
        async with open_recording(Path(folder), station.bus, KEYS, station.clock, print) as recording:
            yield recording.note_monitor


async def to_and_fro(
    station: Station,
    number: int,
    count: int,
    trace: Trace,
    tell: Callable[[int, int], None] = lambda _number, _captured_ns: None,
) -> None:
    """Fly one vehicle to and fro; `tell` gets its number, and when the report that ended a leg was captured, ns."""
    name, near = f"U{number}", start_of(number, count)
    far = near * (1.0 + _LEG_M / abs(near))
    place, covariance = near, _NEAR
    await asyncio.sleep(SETTLING_S * number / count)
    with station.feed.listen(name) as observations:
        noted = Noted(observations)
        for leg in itertools.cycle((leg_between(near, far), leg_between(far, near))):
            now_s = station.clock.now_s()
            monitor = TracedMonitor(
                leg, TRANSMITTERS, place, covariance, now_s, TURN, tell=lambda note: trace(name, note)
            )
            try:
                await station.flight(name, leg, monitor, noted).fly()
            except HoldRequiredError as error:
                print(f"{name}: {error}", file=sys.stderr)
                covariance = _ANYWHERE
            else:
                captured_ns = station.clock.unix_ns() - round((station.clock.now_s() - noted.captured_s) * 1e9)
                tell(number, captured_ns)
                covariance = _NEAR
            place, _ = monitor.standing_place()
            await asyncio.sleep(_RESTS_S)
            observations.forget()
