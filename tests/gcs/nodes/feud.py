"""Two nodes, a service that is replaced, and a network that loses, repeats, delays and reorders: who may command?

Pure: the tenure and the ownership as they are, clocks that drift apart, and everything else out of one seed.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from gcs.nodes.messages import Beat, Grant
from gcs.nodes.ownership import DRIFT, MARGIN_S, NodeView, Ownership, TooEarlyError
from gcs.nodes.tenure import YIELD_S, Authority, Tenure
from gcs.nodes.tokens import Tokens

GRANT_S = 1.0
VEHICLES = ("U1", "U2")
NODES = ("north", "south")
STEP_S = 0.05


@dataclass(frozen=True)
class Hardship:
    """How bad it is."""

    seed: int
    loss: float = 0.1
    longest_delay_s: float = 3.0
    drift: float = 0.005
    """How far clocks run apart, at most half of what is allowed for: two of them."""


@dataclass
class Node:
    """One node with its clock."""

    name: str
    tenure: Tenure
    offset_s: float
    rate: float
    frozen_until_s: float = 0.0

    def clock_s(self, time_s: float) -> float:
        return self.offset_s + self.rate * time_s


@dataclass
class Feud:
    """The world; `make_tenure` and `make_ownership` may be wrong ones."""

    folder: Path
    hardship: Hardship
    make_tenure: Callable[[int], Tenure] = Tenure
    make_ownership: Callable[[Tokens, float, dict[str, NodeView]], Ownership] = Ownership
    time_s: float = 0.0
    contested: list[str] = field(default_factory=list)
    """Who might be commanded by two at a time, and when."""
    obeyed_old: list[str] = field(default_factory=list)
    """Orders by an older token that were obeyed after a newer one had come."""
    granted_s: float = 0.0
    """Vehicle-seconds that somebody might command."""
    given_on: int = 0

    def __post_init__(self) -> None:
        h = self.hardship
        self.random = random.Random(h.seed)
        self.on_their_way: list[tuple[float, int, Callable[[], None]]] = []
        self.numbers = count()
        self.nodes = {
            name: Node(
                name,
                self.make_tenure(1),
                self.random.uniform(0.0, 1e4),
                1.0 + self.random.uniform(-h.drift, h.drift),
            )
            for name in NODES
        }
        self.services: list[Ownership] = []
        self.free_from_s: dict[int, float] = {}
        self.start_service()

    def start_service(self) -> None:
        """A service begins, from what an earlier one left in the run's folder; that one may go on for a while."""
        tokens = Tokens(self.folder / "tokens.jsonl", floor=1000)
        ownership = self.make_ownership(tokens, GRANT_S, {name: NodeView() for name in NODES})
        first = dict(zip(VEHICLES, NODES, strict=True))
        ownership.begin({name: tokens.last[name].node if name in tokens.last else first[name] for name in VEHICLES})
        self.services = [ownership]  # the run's journal is locked: the earlier one has ended
        self.free_from_s[id(ownership)] = self.time_s + (GRANT_S + YIELD_S) * (1.0 + DRIFT) + MARGIN_S

    def send(self, what: Callable[[], None]) -> None:
        for _ in range(2 if self.random.random() < 0.1 else 1):
            if self.random.random() >= self.hardship.loss:
                delay_s = self.random.choice((0.01, 0.05, 0.2, self.hardship.longest_delay_s)) * self.random.random()
                heapq.heappush(self.on_their_way, (self.time_s + delay_s, next(self.numbers), what))

    def run(self, for_s: float) -> Feud:
        while self.time_s < for_s:
            self.time_s += STEP_S
            while self.on_their_way and self.on_their_way[0][0] <= self.time_s:
                heapq.heappop(self.on_their_way)[2]()
            for service in list(self.services):
                self.serve(service)
            if self.random.random() < 0.002:
                self.start_service()
            for node in self.nodes.values():
                self.beat(node)
            self.look()
        return self

    def beat(self, node: Node) -> None:
        if self.random.random() < 0.01:
            node.frozen_until_s = self.time_s + self.random.uniform(0.1, 6.0)
        if self.time_s < node.frozen_until_s or round(self.time_s / STEP_S) % 4:
            return
        beat = Beat(1, round(node.clock_s(self.time_s) * 1e9))
        self.send(lambda: [self.answer(service, node, beat) for service in self.services] and None)

    def answer(self, service: Ownership, node: Node, beat: Beat) -> None:
        grant = service.answer(node.name, beat, self.time_s)
        if grant is not None:
            self.send(lambda: self.hand(node, grant))

    def hand(self, node: Node, grant: Grant) -> None:
        if self.time_s >= node.frozen_until_s:
            node.tenure.take(grant, node.clock_s(self.time_s))

    def serve(self, service: Ownership) -> None:
        if self.time_s < self.free_from_s[id(service)]:
            return
        for name, view in service.nodes.items():
            if view.lost is not None and self.random.random() < 0.05:
                service.find(name)
            elif view.lost is None and self.random.random() < 0.005:
                service.lose(name, "so it seems")
            for vehicle in service.of(name):
                if self.random.random() < 0.05:
                    self.order(name, vehicle, service.held[vehicle].token)
        for vehicle in VEHICLES:
            heir = self.random.choice(NODES)
            if service.held[vehicle].node != heir and self.random.random() < 0.2:
                try:
                    service.give_on([vehicle], heir, self.time_s)
                except TooEarlyError:
                    continue
                self.given_on += 1

    def order(self, node_name: str, vehicle: str, token: int) -> None:
        node = self.nodes[node_name]
        self.send(lambda: node.tenure.assign(vehicle, token, GRANT_S) and None)

        def obey() -> None:
            highest = node.tenure.highest.get(vehicle, 0)
            if node.tenure.obeys(vehicle, token, node.clock_s(self.time_s)) is None and token < highest:
                self.obeyed_old.append(f"{vehicle} by {token} after {highest} at {self.time_s:.2f}")

        self.send(obey)

    def look(self) -> None:
        for vehicle in VEHICLES:
            may = [
                node.name
                for node in self.nodes.values()
                if node.tenure.authority(vehicle, node.clock_s(self.time_s)) is not Authority.NONE
            ]
            self.granted_s += STEP_S * len(may)
            if len(may) > 1:
                self.contested.append(f"{vehicle} at {self.time_s:.2f}")
