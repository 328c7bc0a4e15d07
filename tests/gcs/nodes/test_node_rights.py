"""Link nodes on a closed bus, over a real router: each speaks for itself, and only the service grants."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable

from drivers.bus.certificates import Authority, now
from drivers.bus.keys import SwarmKeys
from drivers.bus.node_keys import NodeKeys
from drivers.bus.security import ROUTER, SERVICE, KeyedEndpoint, configurations, node_party, uav_party
from drivers.bus.session import open_bus
from drivers.simulation.launcher import free_tcp_port

SWARM = "eight"
PATIENCE_S = 20.0


async def until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        await asyncio.sleep(0.02)


async def test_a_node_beats_for_itself_alone_and_only_the_service_grants() -> None:
    endpoint = f"tls/127.0.0.1:{free_tcp_port()}"
    made = configurations(SWARM, ["U1"], endpoint, Authority(SWARM, now(), valid_days=2), ["north", "south"])
    north, south = NodeKeys(SWARM, "north"), NodeKeys(SWARM, "south")
    heard: list[tuple[str, str, bytes]] = []
    alive: list[tuple[str, bool]] = []
    async with contextlib.AsyncExitStack() as stack:
        for party in (ROUTER, SERVICE, node_party("north"), node_party("south"), uav_party("U1")):
            role = "router" if party == ROUTER else "client"
            bus = await stack.enter_async_context(open_bus(KeyedEndpoint(endpoint, role, made[party])))
            if party == SERVICE:
                service = bus
                bus.subscribe(NodeKeys(SWARM).beat, lambda key, payload: heard.append((SERVICE, key, payload)))
                bus.watch_alive(NodeKeys(SWARM).alive, lambda key, is_alive: alive.append((key, is_alive)))
            elif party == node_party("north"):
                at_north = bus
                for key in (north.grant, north.orders, SwarmKeys(SWARM).every_bearings):
                    bus.subscribe(key, lambda key, payload: heard.append(("north", key, payload)))
                bus.declare_alive(north.alive)
                bus.declare_alive(south.alive)  # it may not
            elif party == node_party("south"):
                at_south = bus
            elif party == uav_party("U1"):
                uav = bus
        await until(lambda: (north.alive, True) in alive)
        deadline_s = time.monotonic() + PATIENCE_S
        while {(SERVICE, north.beat, b"own"), ("north", north.grant, b"granted")} - set(heard):
            assert time.monotonic() < deadline_s, heard
            at_south.put_latest(north.beat, b"not its own")
            at_south.put_latest(north.grant, b"from a node")
            uav.put_reliably(north.orders, b"from a UAV")
            at_north.put_latest(north.beat, b"own")
            service.put_latest(north.grant, b"granted", urgent=True)
            uav.put_latest(SwarmKeys(SWARM).bearings("U1"), b"a bearing", urgent=True)
            await asyncio.sleep(0.05)
        await until(lambda: ("north", SwarmKeys(SWARM).bearings("U1"), b"a bearing") in heard)
        assert {payload for _, _, payload in heard} == {b"own", b"granted", b"a bearing"}
        assert south.alive not in {key for key, _ in alive}
