"""The `bus` section of a playbook: where the router is, and who can join."""

from __future__ import annotations

from typing import Annotated

from pydantic import StringConstraints, model_validator

from drivers.bus.openness import openness
from gcs.playbook.sections import Section


class BusSection(Section):
    """The zenoh bus. Without a router endpoint the service starts its own router on loopback."""

    router: Annotated[str, StringConstraints(pattern=r"^(tcp|tls|quic|udp)/.+:\d+$")] | None = None
    keys: Annotated[str, StringConstraints(min_length=1)] | None = None
    """The service's file of `bearing-relay keys init`: nobody else is on the bus but those with keys of theirs."""
    insecure: bool = False
    """Off loopback and without keys whoever reaches the router can command the swarm: this says that it is meant."""

    @model_validator(mode="after")
    def _keys_need_tls(self) -> BusSection:
        if self.keys is not None and not (self.router or "").startswith("tls/"):
            raise ValueError("a bus with keys has its router at tls/HOST:PORT: say so in router")
        return self

    @property
    def problem(self) -> str | None:
        """Why strangers can get at the bus, unless it is meant that they can."""
        if self.router is None or self.keys is not None or self.insecure:
            return None
        problem = openness(self.router)
        return problem and f"{problem}, named in keys, or write insecure: true when nobody else is on that network"
