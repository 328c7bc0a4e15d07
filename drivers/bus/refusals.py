"""What the routers of a closed bus refuse, counted by kind, as they tell it on the bus."""

from __future__ import annotations

from collections import Counter
from typing import Annotated

import msgspec

from drivers.strict_json import read_json

_Count = Annotated[int, msgspec.Meta(ge=0)]


class Refusals(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What was refused since a router began."""

    strangers: _Count = 0
    """Connections without keys of this bus."""
    broken_off: _Count = 0
    """Connections that ended, or took too long, before it was known whose they are."""
    without_rights: _Count = 0
    """Connections with keys that the router's file gives no rights to."""
    speaking: dict[str, _Count] = {}
    """By party: what it said, or offered to answer, in the name of another."""
    asking: dict[str, _Count] = {}
    """By party: what it asked for, commanded or listened to without the right to."""

    @property
    def total(self) -> int:
        """Everything refused, of whatever kind."""
        connections = self.strangers + self.broken_off + self.without_rights
        return connections + sum(self.speaking.values()) + sum(self.asking.values())

    def __add__(self, other: Refusals) -> Refusals:
        """Return what two have refused together."""
        return Refusals(
            self.strangers + other.strangers,
            self.broken_off + other.broken_off,
            self.without_rights + other.without_rights,
            dict(Counter(self.speaking) + Counter(other.speaking)),
            dict(Counter(self.asking) + Counter(other.asking)),
        )

    def __str__(self) -> str:
        """Say it for an operator, on a line."""
        kinds: tuple[tuple[int, str, dict[str, int]], ...] = (
            (self.strangers, "stranger" if self.strangers == 1 else "strangers", {}),
            (sum(self.speaking.values()), "speaking for others", self.speaking),
            (sum(self.asking.values()), "asking for what is not theirs", self.asking),
            (self.without_rights, "with keys but no rights", {}),
            (self.broken_off, "that broke off before they said who they are", {}),
        )
        said = [f"{count} {kind}{_named(parties)}" for count, kind, parties in kinds if count]
        return f"{self.total} refused on the bus" + (f": {', '.join(said)}" if said else "")


def _named(parties: dict[str, int]) -> str:
    return f" ({', '.join(f'{party} {count}' for party, count in sorted(parties.items()))})" if parties else ""


def refusals_key(swarm: str, router: str = "*") -> str:
    """Return where a router tells what it refused, once a second; `*` stands for every router.

    No wildcard of a swarm matches it, so that nobody but routers has a right to say it.
    """
    return f"bearing-relay/{swarm}/@router/{router}/refusals"


def encode_refusals(refusals: Refusals) -> bytes:
    """Return the JSON of what was refused."""
    return msgspec.json.encode(refusals)


def decode_refusals(payload: bytes) -> Refusals:
    """Return what was refused. MalformedError when a payload does not hold that."""
    return read_json(payload, Refusals)
