"""The service's desk: who is refused there, and what becomes of a take-over that fails."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from drivers.bus.node_keys import NodeKeys
from drivers.clock import SystemClock
from gcs.commands.link_node import link_node
from gcs.errors import ServiceError
from gcs.links import open_links
from gcs.nodes.desk import MOST_LIVES, MOST_NODES, READY_TIMEOUT_S
from gcs.nodes.messages import Beat, Done, encode
from gcs.nodes.tokens import FILE, Tokens
from tests.gcs.nodes.relay_on_nodes import TICK_S, NodeWorld


async def test_what_is_no_message_and_what_comes_by_an_old_token_is_counted_and_dropped(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path)
    await world.begin()
    desk, north = world.desk, NodeKeys("small", "north")
    stream = world.executor.leases["U1"]
    before = stream.state
    desk.take_beat(north.beat, b"{}")
    desk.take_report(north.reports, b'{"type":"done"}')
    token = desk.held("U1").token
    desk.take_report(north.reports, encode(Done("U1", token - 1, 9, None, "no")))
    desk.take_report(NodeKeys("small", "south").reports, encode(Done("U1", token, 9, None, "not its own")))
    assert desk.refused == {"malformed": 2, "old token": 2}
    assert stream.state is before
    for number in range(2 * MOST_NODES):
        desk.take_beat(NodeKeys("small", f"stranger-{number}").beat, encode(Beat(1, 1)))
    assert len(desk.ownership.nodes) == MOST_NODES
    await world.end()


async def test_what_nodes_refuse_is_counted_here_over_all_their_lives(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path)
    await world.begin()
    north, south = NodeKeys("small", "north").beat, NodeKeys("small", "south").beat
    for life, stamp, count in ((7, 1, 1), (7, 2, 3), (8, 3, 2), (7, 4, 3)):
        world.desk.take_beat(north, encode(Beat(life, stamp, {}, {"old token": count})))
    world.desk.take_beat(south, encode(Beat(1, 10**18, {}, {"old token": 1, "it is no command": 4})))
    world.desk.take_beat(south, b"no beat")
    assert world.desk.refusals() == {"old token": 6, "it is no command": 4, "malformed": 1}
    for life in range(2 * MOST_LIVES):
        world.desk.take_beat(north, encode(Beat(100 + life, 1, {}, {"malformed": 1})))
    assert world.desk.refusals()["malformed"] < MOST_LIVES
    await world.end()


async def test_a_node_that_is_missing_at_the_start_is_named_with_the_way_out(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path)
    world.network.cut.add("south")
    world.network.parties["south"].declare_alive = lambda _key: None  # type: ignore[method-assign]
    with pytest.raises(ServiceError, match="node south is not there: start it with `bearing-relay link-node south"):
        await world.begin()
    assert world.clock.now_s() > 100.0 + READY_TIMEOUT_S
    await world.end()


async def test_a_node_that_begins_anew_has_lost_its_vehicles(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path)
    await world.begin()
    told: list[str] = []
    world.desk.on_lost.append(lambda node, vehicles, reason: told.append(f"{node} {sorted(vehicles)}: {reason}"))
    world.network.end("north")
    world.desk.take_beat(NodeKeys("small", "north").beat, encode(Beat(2, 1)))
    assert told == ["north ['L0', 'U1']: it has begun anew"]
    await world.end()


async def test_a_node_that_has_let_a_vehicle_go_is_not_trusted_with_it_any_more(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path)
    await world.begin()
    told: list[str] = []
    world.desk.on_lost.append(lambda node, _vehicles, reason: told.append(f"{node}: {reason}"))
    world.nodes["north"].holders.pop("U1")
    for _ in range(12):
        await world.clock.advance(TICK_S)
    assert told == ["north: it has let U1 go"]
    await world.end()


async def test_a_take_over_that_fails_is_said_and_can_be_tried_again(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path, attended=True)
    await world.begin()
    south = world.nodes["south"]
    holder_of = south.holder

    def closed(name: str, *more: Any) -> Any:
        held = holder_of(name, *more)

        async def stay_closed() -> None:
            held.problem = "no route to host"

        held.open = stay_closed  # type: ignore[method-assign]
        return held

    south.holder = closed  # type: ignore[method-assign]
    world.kill("north")
    for _ in range(10):
        await world.clock.advance(TICK_S)
    assert world.speak("takeover", "north").ok
    for _ in range(200):
        await world.clock.advance(TICK_S)
    assert any("not taken over" in said and "no route to host" in said for said in world.said)
    assert not world.speak("resume").ok
    south.holder = holder_of  # type: ignore[method-assign]
    for name in ("L0", "U1"):
        south.tenure.leave(name)
        del south.holders[name]
    assert world.speak("takeover", "north").ok
    for _ in range(60):
        await world.clock.advance(TICK_S)
    assert not world.executor.unreached
    await world.end()


async def test_one_that_cannot_be_reached_can_be_given_up(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path, attended=True)
    await world.begin()
    world.executor.lose_reach("north", ["L0", "U1"], "for a test")
    assert world.speak("skip", "U1").ok
    assert world.speak("skip", "L0").ok
    assert not world.executor.unreached
    await world.end()


async def test_a_resumed_service_knows_who_has_which_vehicle(tmp_path: Path) -> None:
    Tokens(tmp_path / FILE, floor=0).give(["U1"], "south")
    world = NodeWorld(tmp_path)
    assert world.desk.held("U1").node == "south"
    assert world.desk.held("L0").node == "north"


async def test_only_a_flight_speaks_to_nodes(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path)
    with pytest.raises(ServiceError, match="is on a link node"):
        async with open_links(world.playbook, SystemClock(), None):
            pass


def test_the_command_says_what_it_cannot_use(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="is no name"):
        link_node("north/1", "small", "tcp/127.0.0.1:7447")
    with pytest.raises(ServiceError, match="--connect takes the bus router"):
        link_node("north", "small", "127.0.0.1")
    (tmp_path / "file").touch()
    with pytest.raises(ServiceError, match=r"--logs .* cannot be made"):
        link_node("north", "small", "tcp/127.0.0.1:7447", logs=tmp_path / "file" / "logs")
