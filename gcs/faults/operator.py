"""The operator of a campaign's relay, who wants his formation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from drivers.clock import Clock
from gcs.faults.observer import Observer
from gcs.faults.vehicle import FaultyVehicle
from gcs.relay.executor import RelayExecutor

_LOOKS_S: Final = 4.0
_RESUMED: Final = 2


async def operate(
    executor: RelayExecutor, vehicles: Mapping[str, FaultyVehicle], observer: Observer, clock: Clock
) -> None:
    """Have what a pilot has given back, and resume the relay, twice; abort it then.

    Whoever had to stop for a fault may fly again when he resumes.
    """
    resumed = 0
    while True:
        await clock.sleep(_LOOKS_S)
        if not executor.waiting:
            continue
        if resumed == _RESUMED:
            executor.abort("the operator gives up")
            continue
        for name in executor.blocking():
            vehicles[name].give_back()
            vehicles[name].release()
        executor.look()
        observer.stops.clear()
        executor.resume()
        resumed += 1
