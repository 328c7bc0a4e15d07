"""The service's desk for its link nodes: answers their beats with grants, sends orders, and notices who is lost.

A node that is lost is granted nothing more, by nobody but the operator: with his word, and when it can no longer act,
its vehicles are given to another node, or back to it.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

import msgspec

from drivers.bus.messages import ControlReply
from drivers.bus.node_keys import NodeKeys, node_of
from drivers.bus.session import LiveBus
from drivers.clock import Clock
from drivers.errors import DriverError
from gcs.errors import ServiceError
from gcs.nodes.messages import Assign, Beat, HeldVehicle, Order, Post, Telemetry, decode_beat, decode_report, encode
from gcs.nodes.ownership import DRIFT, MARGIN_S, Held, NodeView, Ownership
from gcs.nodes.remote_link import RemoteLink
from gcs.nodes.remote_stream import RemoteStream
from gcs.nodes.tenure import BEAT_S, YIELD_S

WATCH_S: Final = 0.1
ASSIGN_AGAIN_S: Final = 1.0
GONE_S: Final = 2.0 * BEAT_S
"""A node that the bus takes for gone, and that has been silent for so long, is: others come back at once."""
MOST_NODES: Final = 64
MOST_LIVES: Final = 256
STRAY_BEATS: Final = 3
"""So many beats in a row without a vehicle that should be flown are no beats that were just overtaken."""
READY_TIMEOUT_S: Final = 20.0
TAKEN_OVER_TIMEOUT_S: Final = 15.0

Say = Callable[[str], None]


@dataclass(frozen=True)
class Share:
    """A vehicle on a node: everything of its Post but the token, and the service's ends of its link and stream."""

    post: Callable[[int], Post]
    link: RemoteLink
    stream: RemoteStream


@dataclass
class NodeDesk:
    """The desk of one run. `assign` makes what nodes are told of the whole, for some posts.

    `on_lost` is told a lost node, its vehicles and why; `on_back` which of them are the service's to fly again.
    """

    bus: LiveBus
    swarm: str
    clock: Clock
    ownership: Ownership
    assign: Callable[[dict[str, Post]], Assign]
    say: Say
    shares: dict[str, Share] = field(default_factory=dict)
    on_lost: list[Callable[[str, list[str], str], None]] = field(default_factory=list)
    on_back: list[Callable[[list[str]], None]] = field(default_factory=list)
    withheld: Callable[[], Collection[str]] = frozenset
    """The vehicles that the operator has not released."""
    refused: Counter[str] = field(default_factory=Counter)
    """What was not understood, or came from whoever does not have the vehicle."""
    _refused_by: dict[tuple[str, int], dict[str, int]] = field(default_factory=dict, init=False)
    """What each node has refused in each of its lives, by why."""
    _assigned_s: dict[str, float] = field(default_factory=dict, init=False)
    _gone_nodes: set[str] = field(default_factory=set, init=False)
    """The nodes that were lost, and of which it was not said yet that they are back."""
    _taking: dict[str, str] = field(default_factory=dict, init=False)
    """The vehicles that are being taken over, those where that has failed, and from which node."""
    _hurried: set[str] = field(default_factory=set, init=False)
    """The nodes whose grants do not wait for a beat."""
    _busy: asyncio.Task[None] | None = field(default=None, init=False)

    def attach(self) -> None:
        """Listen to all nodes from now on."""
        every = NodeKeys(self.swarm)
        self.bus.subscribe(every.beat, self.take_beat)
        self.bus.subscribe(every.reports, self.take_report)
        self.bus.subscribe(every.telemetry, self.take_report)
        self.bus.watch_alive(every.alive, self.take_liveliness)

    async def run(self) -> None:
        """Notice lost nodes, and see that each holds what it is to hold, until cancelled."""
        try:
            while True:
                self.look()
                await self.clock.sleep(WATCH_S)
        finally:
            if self._busy is not None:
                self._busy.cancel()

    async def begin(self) -> None:
        """Return when every node has taken its vehicles. ServiceError when one is not there or cannot open a link.

        Nobody is granted anything before an earlier service's grants have run out.
        """
        deadline_s = self.clock.now_s() + READY_TIMEOUT_S
        await self.clock.sleep((self.ownership.grant_s + YIELD_S) * (1.0 + DRIFT) + MARGIN_S)
        wanted = {held.node for held in self.ownership.held.values()}
        for node in sorted(wanted):
            while not self._is_there(node):
                if self.clock.now_s() > deadline_s:
                    raise ServiceError(
                        f"node {node} is not there: start it with "
                        f"`bearing-relay link-node {node} --swarm {self.swarm}` and --connect to a router of this bus"
                    )
                await self.clock.sleep(WATCH_S)
            self.ownership.find(node)
        await self._opened(list(self.ownership.held), deadline_s)

    def look(self) -> None:
        """Notice who is lost or back by now, and assign what is not held yet."""
        now_s = self.clock.now_s()
        for node, view in self.ownership.nodes.items():
            if view.lost is None:
                if (reason := self._gone(view, now_s)) is not None:
                    self._lose(node, reason)
                else:
                    self._assign(node, view, now_s)
            elif node in self._gone_nodes and self._is_there(node) and self.ownership.of(node):
                self._gone_nodes.discard(node)
                self._say_back(node)

    def take_over(self, node: str) -> ControlReply:
        """Do as the operator consents: give the vehicles of a lost node to another, or back; say what will be done."""
        vehicles = [name for name in self.ownership.held if self._is_stranded(name, node)]
        if node not in self.ownership.nodes:
            return _no(f"there is no node {node}, but {', '.join(sorted(self.ownership.nodes)) or 'none'}")
        if not vehicles:
            return _no(f"{node} is there and flies its vehicles: nothing is to be taken over")
        if self._busy is not None and not self._busy.done():
            return _no("vehicles are being taken over: wait for it to end")
        owner = self.held(vehicles[0]).node
        heir = self._heir(owner)
        if heir is None:
            return _no(f"no other node is there to take over {', '.join(vehicles)}: start one, or {node} again")
        self._taking |= dict.fromkeys(vehicles, node)
        waits_s = max(0.0, self.ownership.free_at_s(owner) - self.clock.now_s())
        self._busy = asyncio.ensure_future(self._give(vehicles, owner, heir))
        return ControlReply(
            ok=True, message=f"{heir} takes over {', '.join(vehicles)} in {waits_s:.1f} s; then resume brings them on"
        )

    def held(self, vehicle: str) -> Held:
        """Return who has a vehicle, and what its grants say."""
        return self.ownership.held[vehicle]

    def send(self, vehicle: str, order: Order) -> None:
        """Send an order to the node that has a vehicle."""
        self.bus.put_reliably(NodeKeys(self.swarm, self.held(vehicle).node).orders, encode(order))

    def grant_now(self, vehicle: str) -> None:
        """Send the node that has a vehicle its grants at once."""
        if not self._hurried:
            asyncio.get_running_loop().call_soon(self._grant_hurried)  # one for all that are told to stop at once
        self._hurried.add(self.held(vehicle).node)

    def _grant_hurried(self) -> None:
        for node in self._hurried:
            if (grant := self.ownership.grant(node)) is not None:
                self.bus.put_latest(NodeKeys(self.swarm, node).grant, encode(grant), urgent=True)
        self._hurried.clear()

    def lost(self, vehicle: str) -> str | None:
        """Return why the node that has a vehicle is lost, or None."""
        return self.ownership.nodes[self.held(vehicle).node].lost

    def refusals(self) -> dict[str, int]:
        """Return how much was refused here and by the nodes, in all their lives, by why."""
        return dict(sum(map(Counter, self._refused_by.values()), self.refused))

    def take_beat(self, key: str, payload: bytes) -> None:
        """Take a node's beat as it comes off the bus, and answer it."""
        node = node_of(key)
        try:
            beat = decode_beat(payload)
        except msgspec.MsgspecError:
            self.refused["malformed"] += 1
            return
        if node is None:
            return
        view = self._view(node)
        if view is None:
            return
        if view.lost is None and view.beat is not None and view.beat.life != beat.life:
            self._lose(node, "it has begun anew")
        if beat.refused and ((node, beat.life) in self._refused_by or len(self._refused_by) < MOST_LIVES):
            self._refused_by[node, beat.life] = beat.refused
        grant = self.ownership.answer(node, beat, self.clock.now_s())
        if grant is not None:
            self.bus.put_latest(NodeKeys(self.swarm, node).grant, encode(grant), urgent=True)
        for name, vehicle in beat.vehicles.items():
            if name in self.shares and self._speaks_for(node, name, vehicle.token):
                self.shares[name].stream.take_beat(vehicle)
        self._look_for_strays(node, view, beat)

    def take_report(self, key: str, payload: bytes) -> None:
        """Take a node's report as it comes off the bus."""
        node = node_of(key)
        try:
            report = decode_report(payload)
        except msgspec.MsgspecError:
            self.refused["malformed"] += 1
            return
        if node is None:
            return
        if isinstance(report, Telemetry):
            for name, frames in report.frames.items():
                if name in self.shares and self.held(name).node == node:
                    for frame in frames:
                        self.shares[name].link.receive(frame)
        elif report.vehicle in self.shares and self._speaks_for(node, report.vehicle, report.token):
            self.shares[report.vehicle].stream.take(report)
        else:
            self.refused["old token"] += 1

    def take_liveliness(self, key: str, alive: bool) -> None:
        """Take what the bus says of a node's life."""
        node = node_of(key)
        if node is None:
            return
        view = self._view(node)
        if view is not None:
            view.alive = alive

    def _view(self, node: str) -> NodeView | None:
        """Return what is known of a node, also of one that the playbook does not name; None when there are too many."""
        if node not in self.ownership.nodes and len(self.ownership.nodes) >= MOST_NODES:
            self.refused["one node too many"] += 1
            return None
        return self.ownership.nodes.setdefault(node, NodeView())

    def _look_for_strays(self, node: str, view: NodeView, beat: Beat) -> None:
        """Lose a node that has let go of a vehicle that it flew: it was cut off from the service for a while."""
        flown = [name for name in self.ownership.of(node) if name in self.shares and self.shares[name].stream.guided]
        astray = [name for name in flown if name not in self._taking and not self._is_flown(name, beat)]
        view.strays = view.strays + 1 if astray else 0
        if view.lost is None and view.strays >= STRAY_BEATS:
            self._lose(node, f"it has let {', '.join(astray)} go")

    def _is_flown(self, vehicle: str, beat: Beat) -> bool:
        token = self.held(vehicle).token
        return _holds(beat.vehicles, vehicle, token) and beat.vehicles[vehicle].state is not None

    def _speaks_for(self, node: str, vehicle: str, token: int) -> bool:
        held = self.held(vehicle)
        return held.node == node and held.token == token

    def _is_there(self, node: str) -> bool:
        view = self.ownership.nodes.get(node)
        return view is not None and view.alive and self.clock.now_s() - view.heard_s <= self.ownership.grant_s

    def _is_stranded(self, vehicle: str, node: str) -> bool:
        """Return whether a vehicle is a lost node's, or was not taken over from it when that was tried."""
        if self.held(vehicle).node == node and self.lost(vehicle) is not None:
            return True
        return vehicle in self._taking and node in (self._taking[vehicle], self.held(vehicle).node)

    def _gone(self, view: NodeView, now_s: float) -> str | None:
        silent_s = now_s - view.heard_s
        if not view.alive and silent_s > GONE_S:
            return "it has gone from the bus"
        return f"nothing was heard of it for {silent_s:.1f} s" if silent_s > self.ownership.grant_s else None

    def _lose(self, node: str, reason: str) -> None:
        vehicles = self.ownership.lose(node, reason)
        self._gone_nodes.add(node)
        for tell in self.on_lost:
            tell(node, vehicles, reason)

    def _say_back(self, node: str) -> None:
        self.say(f"node {node} is back: `bearing-relay control takeover {node}` gives its vehicles back to it")

    def _heir(self, node: str) -> str | None:
        """Return who takes over from a node: itself, when it is there again, or whoever has least to do."""
        if self._is_there(node):
            return node
        there = [name for name, view in self.ownership.nodes.items() if name != node and self._may_inherit(name, view)]
        return min(there, key=lambda name: (len(self.ownership.of(name)), name), default=None)

    def _may_inherit(self, node: str, view: NodeView) -> bool:
        return self._is_there(node) and (view.lost is None or not self.ownership.of(node))

    def _assign(self, node: str, view: NodeView, now_s: float) -> None:
        """Tell a node, once in a while, what it is to hold and does not."""
        known = {} if view.beat is None else view.beat.vehicles
        missing = [name for name in self.ownership.of(node) if not _holds(known, name, self.held(name).token)]
        if not missing or now_s - self._assigned_s.get(node, float("-inf")) < ASSIGN_AGAIN_S:
            return
        self._assigned_s[node] = now_s
        posts = {name: self.shares[name].post(self.held(name).token) for name in missing}
        self.bus.put_reliably(NodeKeys(self.swarm, node).orders, encode(self.assign(posts)))

    async def _give(self, vehicles: list[str], node: str, heir: str) -> None:
        """Give vehicles of a lost node to another one, and have it fly those that were in flight."""
        try:
            await self.clock.sleep(self.ownership.free_at_s(node) - self.clock.now_s())
            if self.ownership.nodes[node].lost is not None:
                self.ownership.give_on(vehicles, heir, self.clock.now_s())
            self.ownership.find(heir)
            self._assigned_s.pop(heir, None)
            for name in vehicles:
                self.shares[name].link.node = heir
            await self._opened(vehicles, self.clock.now_s() + TAKEN_OVER_TIMEOUT_S)
        except ServiceError as error:
            self.say(f"{', '.join(vehicles)} not taken over: {error}")
            return
        async with asyncio.TaskGroup() as group:
            tasks = {name: group.create_task(self._adopted(name)) for name in vehicles}
        back = [name for name, task in tasks.items() if task.result()]
        for name in back:
            self._taking.pop(name, None)
        self.say(f"{heir} has taken over {', '.join(back) or 'nobody'}")
        for tell in self.on_back:
            tell(back)

    async def _adopted(self, vehicle: str) -> bool:
        stream = self.shares[vehicle].stream
        if not stream.guided:
            return True  # it was never in guided flight
        try:
            await stream.adopt(withheld=vehicle in self.withheld())
        except DriverError as error:
            self.say(f"{error}")
            return False
        return True

    async def _opened(self, vehicles: list[str], deadline_s: float) -> None:
        """Return when all these have open links at their nodes. ServiceError when one has not in time."""
        while waiting := [name for name in vehicles if not self._is_open(name)]:
            if self.clock.now_s() > deadline_s:
                raise ServiceError("; ".join(f"{name}: {self._why_closed(name)}" for name in waiting))
            await self.clock.sleep(WATCH_S)

    def _is_open(self, vehicle: str) -> bool:
        held = self.held(vehicle)
        beat = self.ownership.nodes[held.node].beat
        return beat is not None and _holds(beat.vehicles, vehicle, held.token) and beat.vehicles[vehicle].open

    def _why_closed(self, vehicle: str) -> str:
        held = self.held(vehicle)
        view = self.ownership.nodes[held.node]
        own = None if view.beat is None else view.beat.vehicles.get(vehicle)
        if own is not None and own.problem:
            return f"node {held.node}: {own.problem}"
        return f"node {held.node} does not open its link ({view.lost or 'it is there'})"


def _holds(vehicles: Mapping[str, HeldVehicle], name: str, token: int) -> bool:
    return name in vehicles and vehicles[name].token == token


def _no(message: str) -> ControlReply:
    return ControlReply(ok=False, message=message)
