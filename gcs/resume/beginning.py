"""The first moments of a relay that goes on: nobody is on the air who need not be, and nobody is waited for."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Emission, encode
from drivers.bus.session import Bus
from gcs.relay.executor import RelayExecutor
from gcs.relay.leg_flight import Announce
from gcs.resume.state import Restored


def silence(bus: Bus, keys: SwarmKeys, names: Iterable[str]) -> None:
    """Switch transmitters off: the service that ended may have left them on the air."""
    for name in names:
        bus.put_reliably(keys.emission(name), encode(Emission(on=False)))


def go_on(executor: RelayExecutor, restored: Restored, announce: Announce) -> None:
    """Tell an executor that was made from restored records what it did without, and let it go on when it is run."""
    for name in restored.changed:
        announce(restored.records[name])
    for name in sorted(restored.given_up):
        executor.give_up(name, "given up")
    executor.resume()
