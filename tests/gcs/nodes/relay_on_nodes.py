"""A small relay in virtual time with its vehicles on link nodes: real desk, real nodes, simulated copters."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from drivers.bus.messages import ControlReply, ControlRequest, decode, encode
from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamState
from drivers.tasks import open_background
from gcs.control import ControlDesk
from gcs.nodes.desk import NodeDesk
from gcs.nodes.held_vehicle import Holder
from gcs.nodes.link_node import LinkNode
from gcs.nodes.messages import Adopt, Assign, BringUp, Post
from gcs.nodes.serving import desk_of
from gcs.playbook.schema import Playbook
from gcs.relay.states import ReceiverState
from gcs.simulate.world import RelayWorld
from gcs.stages.operator import Operator
from gcs.traced_monitor import MonitorNote
from tests.fakes import FakeBus, ManualClock, settle
from tests.gcs.nodes.network import Network
from tests.gcs.relay.world import FakeVehicle, World

TICK_S = 0.11
NORTH = ("L0", "U1")
"""Who is on the first of the two nodes."""
SMALL = {
    "playbook": 1,
    "name": "small",
    "formation": {"kind": "custom", "slots": {"O1": [50, 50], "O2": [20, 80]}},
    "transmitters": {"L0": {"at": [0, 0]}, "L1": {"at": [100, 0]}},
    "receivers": {"U1": {"start": [60, 30]}, "U2": {"start": [20, 50]}},
    "planner": {"method": "paper"},
}


class SimHolder(Holder):
    """Holds a simulated copter instead of one behind a link."""

    copter: FakeVehicle

    async def open(self) -> None:
        self.vehicle: Any = SimpleNamespace(silent_for_s=lambda: 0.0)
        self.opening = False

    async def _streamed(self, order: BringUp | Adopt) -> None:
        self._stream: Any = self.copter
        self._autopilot: Any = SimpleNamespace(stream=SimpleNamespace(idle_setpoint=None))
        if not self.copter.guided or (isinstance(order, Adopt) and order.withheld):
            self.copter.state = StreamState.PILOT

    async def close(self) -> None:
        self._end_task()
        self.vehicle = self._stream = None


class SimNode(LinkNode):
    """A link node of simulated copters."""

    copters: dict[str, FakeVehicle]

    def holder(self, name: str, post: Post, assign: Assign) -> Holder:
        held = SimHolder(name, post, assign, self.tenure, self._wires, self.clock, self._report, self._takeovers)
        held.copter = self.copters[name]
        return held


class SkewedClock:
    """The same time; a monotonic clock is off by as much as when its machine was started."""

    def __init__(self, clock: Clock, offset_s: float) -> None:
        self._clock, self._offset_s = clock, offset_s

    def now_s(self) -> float:
        return self._clock.now_s() + self._offset_s

    def unix_ns(self) -> int:
        return self._clock.unix_ns()

    async def sleep(self, duration_s: float) -> None:
        await self._clock.sleep(duration_s)


def on_nodes(playbook: Playbook, node_of: Callable[[str], str]) -> Playbook:
    """The playbook with every vehicle on a node."""
    vehicles = {
        name: {"link": f"udpin:127.0.0.1:{14000 + number}", "system_id": number, "node": node_of(name)}
        for number, name in enumerate(playbook.uavs, start=1)
    }
    written = playbook.model_dump(mode="json", exclude_unset=True)
    written |= {"vehicles": vehicles, "bus": {"router": "tcp/127.0.0.1:7447"}}
    return Playbook.model_validate(written)


class SmallWorld(World):
    """Two receivers flown one after the other by the service itself; notes of their monitors are kept."""

    def __init__(self, *, attended: bool = False) -> None:
        self.notes: list[tuple[str, MonitorNote]] = []
        self.objections: dict[str, str] = {}
        self.history: list[tuple[float, str, ReceiverState, str]] = []
        playbook = Playbook.model_validate(SMALL)
        RelayWorld.__init__(self, playbook, playbook.plan(), ManualClock(), FakeBus(), seed=1, attended=attended)

    def traced(self, receiver: str, note: MonitorNote) -> None:
        self.notes.append((receiver, note))

    async def run(self, limit_s: float = 300.0, meanwhile: Callable[[float], None] = lambda _: None) -> None:
        """Run the relay to its end, with no dwell a whole number of samples: rounding decides nothing."""
        relay, began_s = asyncio.create_task(self.executor.run()), self.clock.now_s()
        while not relay.done():
            assert self.clock.now_s() < began_s + limit_s, "the relay did not end"
            meanwhile(self.clock.now_s() - began_s)
            await self.tick()
        await relay

    async def tick(self) -> None:
        """Measure once, and let time pass."""
        self.measure()
        self.deliver()
        await self.clock.advance(TICK_S)
        self.places()


class NodeWorld(SmallWorld):
    """The relay's world, with every lease at a node of north and south; a node's clock is off by as much as it likes.

    `desk` serves the nodes; the network between them and the service is `network`.
    """

    def __init__(self, folder: Path, *, delay_s: float = 0.0, jitter_s: float = 0.0, attended: bool = False) -> None:
        super().__init__(attended=attended)
        self.network = Network(self.clock, delay_s, jitter_s)
        self.playbook = on_nodes(self.playbook, lambda name: "north" if name in NORTH else "south")
        service: Any = self.network.party("service")
        self.desk: NodeDesk = desk_of(
            self.playbook, folder, service, self.clock, self.clock.unix_ns() // 1_000_000, self.said.append
        )
        for share in self.desk.shares.values():
            share.link.listen(SimpleNamespace(system_id=1, message_ids=frozenset(), handler=None))  # type: ignore[arg-type]
        self.nodes = {name: self._node(name, offset_s) for name, offset_s in (("north", 5e3), ("south", -40.0))}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self.operator = Operator(self.said.append, attended, desk=ControlDesk(self.executor, self.said.append))
        self.operator.take_over = self.desk.take_over

    async def begin(self) -> None:
        """Start nodes and desk, and let every stream begin as the copters fly."""
        for name, node in self.nodes.items():
            self._tasks[name] = asyncio.create_task(node.run())
        self.desk.on_lost.append(self.executor.lose_reach)
        self.desk.on_back.append(self.executor.regain_reach)
        self.desk.withheld = lambda: self.executor.taken
        self.desk.attach()
        self._tasks["desk"] = asyncio.create_task(self.desk.run())
        await self._until(self.desk.begin())
        streams = {name: share.stream for name, share in self.desk.shares.items()}

        async def all_adopted() -> None:
            async with open_background():
                for stream in streams.values():
                    await stream.adopt()

        await self._until(all_adopted())
        self.executor.leases = streams

    def speak(self, verb: Any, name: str | None = None) -> ControlReply:
        """Say a word as over the bus, and return the answer."""
        return decode(self.operator.answer(encode(ControlRequest(verb, name))), ControlReply)

    def is_still(self, name: str) -> bool:
        """Whether a copter was told zero velocity last, or that has been over for long."""
        copter = self.vehicles[name]
        copter.advance()
        return copter.command == 0j

    async def end(self) -> None:
        for task in self._tasks.values():
            task.cancel()
        await settle()

    def kill(self, node: str) -> None:
        """The process of a node ends: its copters are told nothing more by it."""
        self.network.end(node)
        for holder in self.nodes[node].holders.values():
            holder._stream = None
            holder._end_task()
        self._tasks[node].cancel()

    def deliver(self) -> None:
        """Put the reports on the service's own bus, and into the network for the nodes."""
        super().deliver()
        for key, payload in self.bus.sent[self._passed :]:
            if key.endswith("/bearings"):
                for node in self.nodes.values():
                    node._take_bearings(key, payload)
        self._passed = len(self.bus.sent)

    _passed = 0

    async def _until(self, work: Any) -> None:
        task = asyncio.ensure_future(work)
        for _ in range(1000):
            if task.done():
                break
            await self.clock.advance(TICK_S)
        await task

    def _node(self, name: str, offset_s: float) -> SimNode:
        party: Any = self.network.party(name)
        node = SimNode(name, self.playbook.name, party, SkewedClock(self.clock, offset_s), self.said.append, life=1)
        node.copters = dict(self.vehicles)
        return node
