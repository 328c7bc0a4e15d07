"""Who is on the air is told again after the bus was gone: what was told meanwhile got lost."""

from __future__ import annotations

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Emission, decode
from drivers.tasks import background
from gcs.relay.emission import BACK_S, EmissionControl
from tests.fakes import FakeBus, ManualClock

KEYS = SwarmKeys("s")


async def test_what_was_told_while_the_bus_was_gone_is_told_again_for_a_while_when_it_is_back() -> None:
    bus, clock, heard = FakeBus(), ManualClock(), dict[str, bool]()

    def hear(key: str, payload: bytes) -> None:
        heard[key] = decode(payload, Emission).on

    bus.subscribe(KEYS.every_emission, hear)
    emission = EmissionControl(bus, KEYS, clock)
    async with background(emission.run()):
        emission.need("U1", ["L0", "L1"])
        await clock.advance(3.0)
        assert len(bus.sent) == 2
        bus.up = False
        emission.need("U1", ["L1", "U2"])
        await clock.advance(2.0)
        assert heard == {KEYS.emission("L0"): True, KEYS.emission("L1"): True}
        bus.up = True
        await clock.advance(1.0)
        assert heard == {KEYS.emission("L0"): False, KEYS.emission("L1"): True, KEYS.emission("U2"): True}
        heard.clear()  # who joins the bus later than the service
        await clock.advance(BACK_S - 1.0)
        assert heard == {KEYS.emission("L0"): False, KEYS.emission("L1"): True, KEYS.emission("U2"): True}
        sent = len(bus.sent)
        await clock.advance(20.0)
        assert len(bus.sent) == sent
