"""Two sites, each with a router of a closed bus, joined by a link of their own: real routers, real certificates."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import replace

import pytest
import zenoh

from drivers.bus.certificates import Authority, now
from drivers.bus.keys import SwarmKeys
from drivers.bus.node_keys import NodeKeys
from drivers.bus.security import (
    OPERATOR,
    ROUTER,
    SERVICE,
    KeyedEndpoint,
    configurations,
    node_party,
    site_router,
    uav_party,
)
from drivers.bus.session import BusEndpoint, LiveBus, open_bus
from drivers.errors import BusError
from drivers.simulation.launcher import free_tcp_port

SWARM = "eight"
KEYS, NODE = SwarmKeys(SWARM), NodeKeys(SWARM, "south")
U1, U2, SOUTH = uav_party("U1"), uav_party("U2"), site_router("south")
PATIENCE_S = 20.0
QUIET_S = 0.5


class Sites:
    """The ground with its router, and the site south with another; nobody has joined yet."""

    def __init__(self, stack: contextlib.AsyncExitStack) -> None:
        self.ground, self.south = [f"tls/127.0.0.1:{free_tcp_port()}" for _ in range(2)]
        authority = Authority(SWARM, now(), valid_days=2)
        self.made = configurations(SWARM, ["U1", "U2"], self.ground, authority, ["south"], {"south": self.south})
        self._stack = stack

    def router(self, party: str) -> KeyedEndpoint:
        return KeyedEndpoint(self.ground if party == ROUTER else self.south, "router", self.made[party])

    async def route(self, party: str) -> None:
        await self._stack.enter_async_context(open_bus(self.router(party)))

    async def join(self, party: str, endpoint: str) -> LiveBus:
        return await self._stack.enter_async_context(open_bus(KeyedEndpoint(endpoint, "client", self.made[party])))


@pytest.fixture
async def sites() -> AsyncIterator[Sites]:
    async with contextlib.AsyncExitStack() as stack:
        sites = Sites(stack)
        await sites.route(ROUTER)
        yield sites


class Heard:
    """What came to one party."""

    def __init__(self) -> None:
        self.samples: list[tuple[str, bytes]] = []

    def on(self, bus: LiveBus, *keys: str) -> None:
        for key in keys:
            bus.subscribe(key, lambda key, payload: self.samples.append((key, payload)))

    async def until(self, say: Callable[[], None], *samples: tuple[str, bytes]) -> None:
        """Say something again and again until it is heard: who subscribes becomes known a little later."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not set(samples) <= set(self.samples):
            assert time.monotonic() < deadline_s, set(samples) - set(self.samples)
            say()
            await asyncio.sleep(0.02)


async def test_a_swarm_flies_over_two_sites_as_over_one(sites: Sites) -> None:
    await sites.route(SOUTH)
    service, operator = await sites.join(SERVICE, sites.ground), await sites.join(OPERATOR, sites.south)
    uav, node = await sites.join(U1, sites.south), await sites.join(node_party("south"), sites.south)
    at_service, at_south = Heard(), Heard()
    alive: list[tuple[str, bool]] = []
    at_service.on(service, KEYS.every_bearings, NODE.beat)
    at_south.on(uav, KEYS.clock_ping("U1"))
    at_south.on(node, NODE.grant, KEYS.every_bearings)
    at_south.on(operator, KEYS.progress, KEYS.state)
    service.watch_alive(NodeKeys(SWARM).alive, lambda key, is_alive: alive.append((key, is_alive)))
    service.serve(KEYS.control, lambda asked: b"done: " + asked)
    node.declare_alive(NODE.alive)
    bearing, beat = (KEYS.bearings("U1"), b"bearing"), (NODE.beat, b"beat")
    told = [(KEYS.clock_ping("U1"), b"ping"), (NODE.grant, b"grant"), (KEYS.progress, b"leg"), (KEYS.state, b"state")]

    def say() -> None:
        uav.put_latest(*bearing)
        node.put_latest(*beat)
        for each in told:
            service.put_latest(*each)

    await at_service.until(say, bearing, beat)
    await at_south.until(say, *told, bearing)
    answer = b""
    async with asyncio.timeout(PATIENCE_S):
        while not answer:
            with contextlib.suppress(BusError):
                answer = await operator.ask(KEYS.control, b"hold")
    assert answer == b"done: hold"
    assert (NODE.alive, True) in alive


async def test_a_site_s_router_lets_nobody_speak_for_another(sites: Sites) -> None:
    await sites.route(SOUTH)
    service, heard = await sites.join(SERVICE, sites.ground), Heard()
    uav, other = await sites.join(U1, sites.south), await sites.join(U2, sites.south)
    heard.on(service, KEYS.every_bearings, KEYS.progress)
    service.serve(KEYS.control, lambda _: b"done")

    def say() -> None:
        uav.put_latest(KEYS.bearings("U2"), b"forged")
        uav.put_latest(KEYS.progress, b"forged")
        uav.put_latest(KEYS.bearings("U1"), b"own")
        other.put_latest(KEYS.bearings("U2"), b"own")

    await heard.until(say, (KEYS.bearings("U1"), b"own"), (KEYS.bearings("U2"), b"own"))
    assert b"forged" not in {payload for _, payload in heard.samples}
    with pytest.raises(BusError, match="is not answered"):
        await uav.ask(KEYS.control, b"abort")


def without_keys(own: str, ground: str) -> zenoh.Config:
    """Return a router of a stranger's that connects to the ground's."""
    config = BusEndpoint(own, "router").configuration()
    config.insert_json5("connect/endpoints", json.dumps([ground]))
    return config


def with_a_uav_s_keys(own: str, sites: Sites) -> zenoh.Config:
    """Return a router that connects to the ground's with what was found on a UAV."""
    config = without_keys(own, sites.ground)
    link = json.loads(sites.made[U1])["transport"]["link"]
    config.insert_json5("transport/link/tls", json.dumps(link["tls"]))
    return config


def of_another_authority(own: str, sites: Sites) -> zenoh.Config:
    """Return a site's router with keys that somebody made himself, who has found the true authority's certificate."""
    made = configurations(SWARM, ["U1"], sites.ground, Authority(SWARM, now(), 2), [], {"south": sites.south})
    values, true = json.loads(made[SOUTH]), json.loads(sites.made[SOUTH])["transport"]["link"]["tls"]
    values["transport"]["link"]["tls"]["root_ca_certificate_base64"] = true["root_ca_certificate_base64"]
    config = replace(sites.router(SOUTH), keys=json.dumps(values)).configuration()
    config.insert_json5("listen/endpoints", json.dumps([own]))
    config.insert_json5("transport/link/protocols", json.dumps(["tls", "tcp"]))
    config.insert_json5("access_control/enabled", "false")
    return config


FALSE_ROUTERS: dict[str, Callable[[str, Sites], zenoh.Config]] = {
    "without keys": lambda own, sites: without_keys(own, sites.ground),
    "with a UAV's keys": with_a_uav_s_keys,
    "of another authority": of_another_authority,
}


@pytest.mark.parametrize("kind", FALSE_ROUTERS)
async def test_behind_a_router_that_is_none_of_the_bus_nobody_says_or_hears_anything(sites: Sites, kind: str) -> None:
    service, at_service, behind = await sites.join(SERVICE, sites.ground), Heard(), Heard()
    at_service.on(service, KEYS.every_bearings, KEYS.progress, NODE.beat)
    own = f"tcp/127.0.0.1:{free_tcp_port()}"
    with contextlib.closing(await asyncio.to_thread(zenoh.open, FALSE_ROUTERS[kind](own, sites))):
        async with open_bus(BusEndpoint(own)) as stranger:
            behind.on(stranger, "bearing-relay/eight/**", NODE.grant, KEYS.state)
            until_s = time.monotonic() + QUIET_S
            while time.monotonic() < until_s:
                for key in (KEYS.bearings("U2"), KEYS.progress, NODE.beat):
                    stranger.put_latest(key, b"from nowhere")
                for key in (KEYS.setup, NODE.grant, KEYS.state):
                    service.put_latest(key, b"not for them")
                await asyncio.sleep(0.05)
            uav = await sites.join(U2, sites.ground)
            last = (KEYS.bearings("U2"), b"own")
            await at_service.until(lambda: uav.put_latest(*last), last)
    assert {payload for _, payload in at_service.samples} == {b"own"}
    assert b"not for them" not in {payload for _, payload in behind.samples}
