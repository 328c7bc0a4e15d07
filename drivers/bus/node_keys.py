"""The keys of link nodes on the bus. No wildcard of a swarm matches them: whoever records it is spared their frames."""

from __future__ import annotations

import re
from dataclasses import dataclass

from drivers.bus.keys import NAME_PATTERN


@dataclass(frozen=True)
class NodeKeys:
    """The keys between the service of a swarm and one link node; `*` stands for every node."""

    swarm: str
    node: str = "*"

    @property
    def alive(self) -> str:
        """Liveliness of the node."""
        return self._key("alive")

    @property
    def beat(self) -> str:
        """The node's signs of life, of which only the latest counts."""
        return self._key("beat")

    @property
    def grant(self) -> str:
        """The service's answers to them."""
        return self._key("grant")

    @property
    def orders(self) -> str:
        """What the service wants done."""
        return self._key("orders")

    @property
    def reports(self) -> str:
        """What became of that."""
        return self._key("reports")

    @property
    def telemetry(self) -> str:
        """What vehicles say."""
        return self._key("telemetry")

    @property
    def every_key(self) -> str:
        """All of these."""
        return f"bearing-relay/{self.swarm}/@node/{self.node}/*"

    def _key(self, last: str) -> str:
        return f"bearing-relay/{self.swarm}/@node/{self.node}/{last}"


_NODE_KEY = re.compile(rf"bearing-relay/{NAME_PATTERN}/@node/({NAME_PATTERN})/\w+")


def node_of(key: str) -> str | None:
    """Return the node that a key belongs to, or None when it is no node's."""
    match = _NODE_KEY.fullmatch(key)
    return match[1] if match else None
