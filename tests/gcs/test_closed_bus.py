"""The bearings of a swarm whose bus is closed: what a stranger, a forger, a replayer and a wrong clock get to say."""

from __future__ import annotations

import asyncio
import contextlib
import random
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import asdict
from pathlib import Path

import pytest

from drivers.bus.certificates import Authority, now
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Bearing, BearingReport, encode
from drivers.bus.security import ROUTER, SERVICE, KeyedEndpoint, configurations, uav_party
from drivers.bus.session import Bus, BusEndpoint, open_bus
from drivers.clock import SystemClock
from drivers.errors import BusError
from drivers.simulation.launcher import free_tcp_port
from gcs.bearings import BearingFeed
from gcs.refused_on_bus import RefusedOnBus
from planner.frames import FormationFrame
from tests.drivers.bus.test_refusals import SWARM, Closed

KEYS = SwarmKeys("two")
UAVS = ["U1", "U2"]
PATIENCE_S = 20.0


class Field:
    """What the service hears of two UAVs over a closed bus on loopback; `uavs` are their ways onto it."""

    def __init__(self, feed: BearingFeed, endpoint: str, uavs: dict[str, Bus]) -> None:
        self.feed = feed
        self.endpoint = endpoint
        self.uavs = uavs

    def dropped(self, name: str) -> dict[str, int]:
        counted = asdict(self.feed.by_receiver[name])
        return {reason: count for reason, count in counted.items() if count and reason != "received"}

    def received(self, name: str) -> int:
        return self.feed.by_receiver[name].received

    async def until(self, holds: Callable[[], bool], say: Callable[[], None] = lambda: None) -> None:
        """Say something again and again until it has had its effect."""
        async with asyncio.timeout(PATIENCE_S):
            while not holds():
                say()
                await asyncio.sleep(0.01)


@pytest.fixture
async def field() -> AsyncIterator[Field]:
    endpoint = f"tls/127.0.0.1:{free_tcp_port()}"
    made = configurations(KEYS.swarm, UAVS, endpoint, Authority(KEYS.swarm, now(), valid_days=2))
    feed = BearingFeed(UAVS, FormationFrame(0.0), SystemClock(), max_age_s=5.0)
    async with contextlib.AsyncExitStack() as stack:
        await stack.enter_async_context(open_bus(KeyedEndpoint(endpoint, "router", made[ROUTER])))
        service = await stack.enter_async_context(open_bus(KeyedEndpoint(endpoint, "client", made[SERVICE])))
        feed.attach(service, KEYS)
        uavs = {
            name: await stack.enter_async_context(open_bus(KeyedEndpoint(endpoint, "client", made[uav_party(name)])))
            for name in UAVS
        }
        heard = Field(feed, endpoint, uavs)
        for name, bus in uavs.items():  # until the service's subscription is known everywhere
            await heard.until(
                lambda name=name: heard.received(name) > 0,
                lambda name=name, bus=bus: bus.put_latest(KEYS.bearings(name), a_report(), urgent=True),
            )
        yield heard


def a_report(ahead_s: float = 0.0) -> bytes:
    captured_ns = time.time_ns() + round(ahead_s * 1e9)
    bearing = Bearing("L0", random.gauss(1.0, 0.01), 0.01)
    return encode(BearingReport(captured_ns, captured_ns // 1000, "true_north", [bearing]))


async def test_a_stranger_is_not_on_the_bus_and_disturbs_nobody(field: Field) -> None:
    for stranger in (BusEndpoint(field.endpoint), BusEndpoint(field.endpoint.replace("tls/", "tcp/"))):
        with pytest.raises(BusError, match="cannot be opened"):
            async with open_bus(stranger) as bus:
                bus.put_latest(KEYS.bearings("U1"), a_report())
    before = field.received("U1")
    await field.until(
        lambda: field.received("U1") > before,
        lambda: field.uavs["U1"].put_latest(KEYS.bearings("U1"), a_report(), urgent=True),
    )
    assert field.dropped("U1") == {}


async def test_a_uav_speaks_for_itself_alone(field: Field) -> None:
    uav, theirs, own = field.uavs["U1"], field.received("U2"), field.received("U1")
    for _ in range(20):
        uav.put_latest(KEYS.bearings("U2"), a_report(), urgent=True)
    await field.until(  # what it says of itself goes the same way, behind what it said of the other
        lambda: field.received("U1") > own,
        lambda: uav.put_latest(KEYS.bearings("U1"), a_report(), urgent=True),
    )
    assert field.received("U2") == theirs


async def test_a_report_said_again_is_counted_and_moves_nobody(field: Field) -> None:
    first = a_report()
    uav = field.uavs["U1"]
    before = field.received("U1")
    uav.put_latest(KEYS.bearings("U1"), first, urgent=True)
    await field.until(lambda: field.received("U1") == before + 1)
    taken = field.feed.latest["U1"]
    for _ in range(3):
        uav.put_latest(KEYS.bearings("U1"), first, urgent=True)
    await field.until(lambda: field.received("U1") == before + 4)
    assert field.dropped("U1") == {"duplicate": 3}
    assert field.feed.latest["U1"] is taken


async def test_an_old_report_among_new_ones_is_counted_and_moves_nobody(field: Field) -> None:
    recorded, uav = a_report(), field.uavs["U1"]
    before = field.received("U1")
    uav.put_latest(KEYS.bearings("U1"), a_report(), urgent=True)
    uav.put_latest(KEYS.bearings("U1"), recorded, urgent=True)
    await field.until(lambda: field.received("U1") == before + 2)
    assert field.dropped("U1") == {"out_of_order": 1}


async def test_a_report_of_the_future_is_counted_and_moves_nobody(field: Field) -> None:
    taken, before = field.feed.latest["U1"], field.received("U1")
    field.uavs["U1"].put_latest(KEYS.bearings("U1"), a_report(ahead_s=3600.0), urgent=True)
    await field.until(lambda: field.received("U1") == before + 1)
    assert field.dropped("U1") == {"from_the_future": 1}
    assert field.feed.latest["U1"] is taken


@pytest.mark.slow
async def test_strangers_forgers_replays_and_the_future_are_refused_and_counted_before_the_operator(
    tmp_path: Path,
) -> None:
    closed, said = Closed(tmp_path), list[str]()
    keys, clock = SwarmKeys(SWARM), SystemClock()
    feed = BearingFeed(UAVS, FormationFrame(0.0), clock, max_age_s=5.0)
    refused = RefusedOnBus(clock, said.append)
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(closed.routed())
        service = await stack.enter_async_context(closed.joined(SERVICE))
        uav = await stack.enter_async_context(closed.joined(uav_party("U1")))
        feed.attach(service, keys)
        refused.attach(service, SWARM)
        heard = Field(feed, closed.endpoint, {"U1": uav})

        def say(report: bytes, of: str = "U1") -> None:
            uav.put_latest(keys.bearings(of), report, urgent=True)

        await heard.until(lambda: heard.received("U1") > 0, lambda: say(a_report()))
        replayed = a_report()
        for report in (replayed, replayed, a_report(ahead_s=3600.0)):
            say(report)
        for _ in range(3):
            say(a_report(), of="U2")
        for _ in range(2):
            with pytest.raises(BusError, match="cannot be opened"):
                async with open_bus(BusEndpoint(closed.endpoint)):
                    pass
        await heard.until(lambda: refused.total.total >= 5 and sum(heard.dropped("U1").values()) >= 2)
    assert heard.dropped("U1") == {"duplicate": 1, "from_the_future": 1}
    assert heard.received("U2") == 0
    assert refused.alert() == "5 refused on the bus: 2 strangers, 3 speaking for others (uav.U1 3)"
    assert said
