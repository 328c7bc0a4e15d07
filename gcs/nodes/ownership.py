"""Who has which vehicle: one node at a time, by a token, and another one only when the first can no longer act.

A node acts on a grant that answers one of its beats, for `grant_s` from that beat on, and stops its vehicles for
YIELD_S after that. The service heard the beat later than it was made: so much time after it was heard, both are over
for certain, whatever was lost or held up on its way and whatever the node's clock shows.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

from gcs.errors import ServiceError
from gcs.nodes.messages import Beat, Grant, VehicleGrant
from gcs.nodes.tenure import YIELD_S
from gcs.nodes.tokens import Tokens

MARGIN_S: Final = 0.25
DRIFT: Final = 0.01
"""By how much a node's clock may run slower than the service's; a crystal is a hundred times better."""


class TooEarlyError(ServiceError):
    """A vehicle was to be given on while its node might still act."""


@dataclass
class NodeView:
    """A node as the service sees it."""

    heard_s: float = float("-inf")
    """When its last beat came."""
    answered_s: float = float("-inf")
    """When the last beat came that was answered with a grant."""
    beat: Beat | None = None
    alive: bool = False
    """Whether the bus says that it lives."""
    lost: str | None = "it has not been heard yet"
    """Why it is granted nothing, or None."""
    strays: int = 0
    """In how many beats in a row vehicles were missing that it should fly."""


@dataclass
class Held:
    """A vehicle, the node that has it, and what its grants say."""

    node: str
    token: int
    stops: int = 0
    objection: str = ""

    def granted(self) -> VehicleGrant:
        """Return its part of a grant."""
        return VehicleGrant(self.token, self.stops, self.objection)


@dataclass
class Ownership:
    """Every vehicle of a run that is on a node. `nodes` are all there may be."""

    tokens: Tokens
    grant_s: float
    nodes: dict[str, NodeView]
    held: dict[str, Held] = field(default_factory=dict)
    _number: int = 0

    def begin(self, node_of: Mapping[str, str]) -> None:
        """Give every vehicle to its first node. ServiceError when that cannot be kept."""
        for node in self.nodes:
            self._give([name for name, of in node_of.items() if of == node], node)

    def of(self, node: str) -> list[str]:
        """Return the vehicles that a node has."""
        return [name for name, held in self.held.items() if held.node == node]

    def answer(self, node: str, beat: Beat, now_s: float) -> Grant | None:
        """Take a node's beat in; return the grant that answers it, or None for one that is granted nothing."""
        view = self.nodes[node]
        if view.beat is not None and view.beat.life == beat.life and view.beat.stamp_ns >= beat.stamp_ns:
            return None  # it has been overtaken
        view.heard_s, view.beat = now_s, beat
        if view.lost is not None:
            return None
        return self.grant(node)

    def grant(self, node: str) -> Grant | None:
        """Return the grant of now, for the last beat; None for a node that is granted nothing."""
        view = self.nodes[node]
        if view.lost is not None or view.beat is None:
            return None
        view.answered_s = view.heard_s
        self._number += 1
        vehicles = {name: self.held[name].granted() for name in self.of(node)}
        return Grant(view.beat.life, view.beat.stamp_ns, self._number, vehicles)

    def find(self, node: str) -> None:
        """Grant a node its vehicles from its next beat on."""
        self.nodes[node].lost = None

    def lose(self, node: str, reason: str) -> list[str]:
        """Grant a node nothing any more, and return its vehicles."""
        self.nodes[node].lost = reason
        return self.of(node)

    def free_at_s(self, node: str) -> float:
        """Return when a lost node can no longer act."""
        return self.nodes[node].answered_s + (self.grant_s + YIELD_S) * (1.0 + DRIFT) + MARGIN_S

    def give_on(self, vehicles: Collection[str], heir: str, now_s: float) -> None:
        """Give vehicles of lost nodes to another node, or back. TooEarlyError while the one that has them may act."""
        for name in vehicles:
            node = self.held[name].node
            if self.nodes[node].lost is None or now_s < self.free_at_s(node):
                raise TooEarlyError(f"{name} is not given to {heir}: {node} may still act on its last grant")
        self._give(vehicles, heir)

    def _give(self, vehicles: Collection[str], node: str) -> None:
        for name, token in self.tokens.give(vehicles, node).items():
            self.held[name] = Held(node, token)
