"""A relay whose legs are flown at link nodes, in virtual time: as here, cut off, killed, taken over."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.mavlink.setpoints import StreamState
from gcs.nodes.desk import WATCH_S
from gcs.nodes.held_leg import CUT_OFF
from gcs.nodes.link_node import WATCH_S as NODE_WATCH_S
from gcs.nodes.serving import GRANT_S
from gcs.nodes.tenure import BEAT_S, YIELD_S
from gcs.relay.states import ReceiverState
from gcs.traced_monitor import MonitorNote
from tests.gcs.nodes.relay_on_nodes import TICK_S, NodeWorld, SmallWorld
from tests.gcs.relay.world import LEASE_S

PLACED, HELD, PILOT, LEG_1 = ReceiverState.PLACED, ReceiverState.HELD, ReceiverState.PILOT, ReceiverState.LEG_1
FIRST = "U1"
"""The first to fly, from the north."""


def decisions(notes: list[tuple[str, MonitorNote]]) -> Iterator[tuple[str, bool, complex, float]]:
    """Every decision of every monitor: whose, whether it arrived, and where it would come to rest."""
    for receiver, note in notes:
        if note.asked is not None:
            yield receiver, note.asked.arrived, complex(*note.asked.at_rest_m), note.asked.sigma_m


async def test_the_relay_forms_up_at_nodes_by_the_decisions_of_one_that_is_flown_here(tmp_path: Path) -> None:
    local, world = SmallWorld(), NodeWorld(tmp_path)
    await world.begin()
    await local.clock.advance(world.clock.now_s() - local.clock.now_s())
    await local.run()
    await world.run()
    assert world.executor.formed, world.said
    assert max(world.errors_m().values()) < 1.0
    there, here = list(decisions(world.notes)), list(decisions(local.notes))
    assert [each[:2] for each in there] == [each[:2] for each in here]
    for (_, _, at_rest, sigma_m), (_, _, local_at_rest, local_sigma_m) in zip(there, here, strict=True):
        assert at_rest == pytest.approx(local_at_rest, abs=1e-6)
        assert sigma_m == pytest.approx(local_sigma_m, abs=1e-6)
    assert sum(arrived for _, arrived, _, _ in there) == 4
    assert not any(node.tenure.refused for node in world.nodes.values())
    await world.end()


async def test_delays_between_node_and_service_change_no_stop(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path, delay_s=0.05, jitter_s=0.1)
    await world.begin()
    await world.run()
    assert world.executor.formed, world.said
    assert max(world.errors_m().values()) < 1.0
    await world.end()


class Story:
    """Something that happens once the first receiver is under way, and what is seen of it until the relay ends."""

    def __init__(self, world: NodeWorld, happens: Callable[[], None]) -> None:
        self.world, self.happens = world, happens
        self.happened_s: float | None = None
        self.still_s: float | None = None
        self.then: list[tuple[float, Callable[[], None]]] = []

    def look(self, _since_s: float) -> None:
        world, now_s = self.world, self.world.clock.now_s()
        copter = world.vehicles[FIRST]
        if self.happened_s is None:
            if world.states()[FIRST] is LEG_1 and abs(copter.velocity) > 2.0:
                self.happened_s = now_s
                self.happens()
            return
        if world.is_still(FIRST) and self.still_s is None:
            self.still_s = now_s
        while self.then and now_s >= self.happened_s + self.then[0][0]:
            self.then.pop(0)[1]()

    @property
    def stopped_after_s(self) -> float:
        assert self.happened_s is not None
        assert self.still_s is not None
        return self.still_s - self.happened_s


def takeover(world: NodeWorld, node: str = "north") -> Callable[[], None]:
    def say() -> None:
        reply = world.speak("takeover", node)
        assert reply.ok, reply.message

    return say


def resume(world: NodeWorld) -> Callable[[], None]:
    def say() -> None:
        reply = world.speak("resume")
        assert reply.ok, reply.message

    return say


async def test_cut_off_a_node_stops_its_vehicles_and_another_takes_them_over_with_consent(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path, attended=True)
    await world.begin()
    story = Story(world, lambda: world.network.cut.add("north"))
    commanded_s: list[float] = []

    def before_consent() -> None:
        assert world.states()[FIRST] is HELD
        assert "link node north is lost" in (world.executor.held or "")
        assert FIRST in world.executor.unreached
        assert world.desk.held(FIRST).node == "north"
        refused = world.speak("resume")
        assert not refused.ok
        assert "takeover north" in refused.message
        assert "bearing-relay control takeover north" in world.executor.ways_out()
        assert not world.nodes["north"].holders  # let go
        commanded_s.extend(s for s in world.vehicles[FIRST].renewals if s > (story.happened_s or 0.0) + GRANT_S)

    story.then = [(20.0, before_consent), (20.5, takeover(world)), (26.0, resume(world))]
    await world.run(meanwhile=story.look)
    assert story.stopped_after_s <= GRANT_S + NODE_WATCH_S + TICK_S
    assert not commanded_s
    assert world.executor.formed, world.said
    assert max(world.errors_m().values()) < 1.0
    assert {held.node for held in world.desk.ownership.held.values()} == {"south"}
    assert set(world.nodes["south"].holders) == set(world.vehicles)
    assert any("south has taken over" in said for said in world.said)
    await world.end()


async def test_the_leg_of_a_node_that_is_cut_off_ends_with_that_reason(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path)
    await world.begin()
    told: list[bytes] = []
    north = world.network.parties["north"]

    def cut() -> None:
        told.clear()
        world.network.cut.add("north")
        north.subscribe("bearing-relay/small/@node/north/reports", lambda _key, payload: told.append(payload))

    story = Story(world, cut)
    await world.run(meanwhile=story.look)
    assert not world.executor.formed  # nobody attends
    await world.clock.advance(5.0)
    assert any(CUT_OFF.encode() in payload for payload in told)
    await world.end()


async def test_a_killed_node_is_noticed_soon_and_its_vehicles_fly_on_from_another(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path, attended=True)
    await world.begin()
    story = Story(world, lambda: world.kill("north"))
    noticed: list[bool] = []
    story.then = [
        (0.8, lambda: noticed.append(world.states()[FIRST] is HELD)),
        (1.0, takeover(world)),
        (9.0, resume(world)),
    ]
    await world.run(meanwhile=story.look)
    assert noticed == [True]
    assert story.stopped_after_s <= LEASE_S + 2 * TICK_S
    assert world.executor.formed, world.said
    assert max(world.errors_m().values()) < 1.0
    await world.end()


async def test_nothing_is_taken_over_before_the_old_grant_has_run_out_or_of_a_node_that_is_there(
    tmp_path: Path,
) -> None:
    world = NodeWorld(tmp_path, attended=True)
    await world.begin()
    owners: list[str] = []
    refused = world.speak("takeover", "north")
    assert not refused.ok
    assert "is there" in refused.message
    assert not world.speak("takeover", "west").ok
    assert not world.speak("takeover").ok
    story = Story(world, lambda: world.kill("north"))
    story.then = [
        (0.9, takeover(world)),
        (0.2 + GRANT_S + YIELD_S - BEAT_S - WATCH_S, lambda: owners.append(world.desk.held(FIRST).node)),
        (8.0, lambda: owners.append(world.desk.held(FIRST).node)),
        (8.1, lambda: world.speak("abort") and None),
    ]
    await world.run(meanwhile=story.look)
    assert owners == ["north", "south"]
    await world.end()


async def test_a_node_that_comes_back_gets_its_vehicles_again_with_consent(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path, attended=True)
    await world.begin()
    story = Story(world, lambda: world.network.cut.add("north"))
    story.then = [
        (6.0, lambda: world.network.heal("north")),
        (12.0, takeover(world)),
        (18.0, resume(world)),
    ]
    await world.run(meanwhile=story.look)
    assert world.executor.formed, world.said
    assert any("node north is back" in said for said in world.said)
    assert world.desk.held(FIRST).node == "north"
    await world.end()


async def test_without_the_service_every_node_stops_its_vehicles(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path, attended=True)
    await world.begin()
    story = Story(world, lambda: world.network.cut.add("service"))
    let_go: list[bool] = []
    story.then = [
        (8.0, lambda: let_go.append(not world.nodes["north"].holders and not world.nodes["south"].holders)),
        (8.1, lambda: world.speak("abort") and None),
    ]
    await world.run(meanwhile=story.look)
    assert story.stopped_after_s <= GRANT_S + NODE_WATCH_S + TICK_S
    assert let_go == [True]
    await world.end()


async def test_one_that_its_pilot_has_is_its_pilot_s_after_a_take_over(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path, attended=True)
    await world.begin()

    def happens() -> None:
        world.kill("north")
        world.vehicles[FIRST].take_over()

    story = Story(world, happens)
    states: list[StreamState] = []
    story.then = [
        (1.0, takeover(world)),
        (9.0, lambda: states.append(world.executor.leases[FIRST].state)),
        (9.1, lambda: states.append(world.executor.leases["L0"].state)),
        (9.2, lambda: world.speak("abort") and None),
    ]
    before = len(world.vehicles[FIRST].renewals)
    await world.run(meanwhile=story.look)
    assert states[0] is StreamState.PILOT
    assert states[1] is not StreamState.PILOT
    assert world.states()[FIRST] is PILOT
    assert before == 0
    await world.end()


async def test_an_operator_s_hold_stops_a_leg_at_its_node_at_once(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path, attended=True)
    await world.begin()
    story = Story(world, lambda: world.speak("hold") and None)
    story.then = [(5.0, resume(world))]
    await world.run(meanwhile=story.look)
    assert story.stopped_after_s <= TICK_S
    assert world.executor.formed, world.said
    await world.end()


async def test_an_objection_of_the_service_stops_a_vehicle_at_its_node(tmp_path: Path) -> None:
    world = NodeWorld(tmp_path)
    await world.begin()
    story = Story(world, lambda: world.objections.update({FIRST: "only 1.0 m from U2"}))
    story.then = [(2.0, world.objections.clear)]
    await world.run(meanwhile=story.look)
    assert story.stopped_after_s <= 4 * TICK_S
    assert any("only 1.0 m from U2" in reason for _, name, _, reason in world.history if name == FIRST)
    assert world.executor.formed, world.said
    await world.end()
