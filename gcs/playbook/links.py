"""The sections of a playbook about MAVLink: this service on its links, and how each UAV is reached."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, StringConstraints, WithJsonSchema, model_validator

from drivers.bus.keys import NAME_PATTERN
from drivers.errors import LinkError
from drivers.mavlink.transport import LinkAddress
from gcs.playbook.sections import Name, Section
from gcs.playbook.suggestions import refuse, suggestion


def _read_link(value: Any) -> str:
    try:
        return str(LinkAddress.parse(value if isinstance(value, str) else ""))
    except LinkError as error:
        raise ValueError(str(error)) from error


Link = Annotated[
    str,
    BeforeValidator(_read_link),
    WithJsonSchema({"type": "string", "pattern": r"^\s*((udpin|udpout|tcp):.+:\d{1,5}|serial:\S+:[1-9]\d{1,6})\s*$"}),
]


NodeName = Annotated[str, StringConstraints(pattern=rf"^{NAME_PATTERN}$", max_length=64)]


class Signing(Section):
    """Where the key of signed links is: in a file that only its owner can read, or in an environment variable."""

    key_file: Annotated[str, StringConstraints(min_length=1)] | None = None
    key_variable: Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")] | None = None

    @model_validator(mode="after")
    def _one_place(self) -> Signing:
        if (self.key_file is None) == (self.key_variable is None):
            raise ValueError("a signing key is in a key_file or in a key_variable: name exactly one")
        return self


class Mavlink(Section):
    """What this service is on every MAVLink link."""

    system_id: Annotated[int, Field(ge=1, le=255)] = 255
    signing: Signing | None = None


class VehicleLayer(Section):
    """What may be said of all vehicles (`fleet`), of those of one type, or of one: the later of these wins."""

    link: Link | None = None
    fallback: list[Link] | None = None
    system_id: Annotated[int, Field(ge=1, le=254)] | None = None
    autopilot: Literal["ardupilot", "px4"] | None = None
    signing: Signing | None = None
    node: NodeName | None = None
    """The link node that has the link; without one the service opens it itself."""

    def given(self) -> dict[str, Any]:
        """Return what it says."""
        return {name: value for name, value in self if value is not None}


class VehicleEntry(VehicleLayer):
    """What is said of one vehicle."""

    type: Name | None = None


class VehicleLink(VehicleEntry):
    """How a UAV is reached over MAVLink, and what it is where its heartbeat is not to be believed."""

    link: Link
    fallback: list[Link] = Field(default_factory=list)
    system_id: Annotated[int, Field(ge=1, le=254)]

    @property
    def links(self) -> tuple[str, ...]:
        """Every link to it, the preferred one first."""
        return (self.link, *self.fallback)


def layered(value: Any, fleet: VehicleLayer, types: Mapping[str, VehicleLayer]) -> Any:
    """Return the `vehicles` of a playbook as written, each entry on top of its type and the fleet.

    Raises pydantic's ValidationError where a type is not there; what is no mapping is left to be refused later.
    """
    if not isinstance(value, dict):
        return value
    entries = {name: entry for name, entry in value.items() if isinstance(entry, dict)}
    kinds = {name: entry["type"] for name, entry in entries.items() if isinstance(entry.get("type"), str)}
    refuse(
        ((name, "type"), f"{kind!r} is no type of vehicle_types{suggestion(kind, types)}")
        for name, kind in kinds.items()
        if kind not in types
    )
    under = {name: fleet.given() | (types[kinds[name]].given() if name in kinds else {}) for name in entries}
    own = {name: {key: said for key, said in entry.items() if said is not None} for name, entry in entries.items()}
    return {name: under[name] | own[name] if name in entries else value[name] for name in value}


def clashes(vehicles: Mapping[str, VehicleLink], mavlink: Mavlink) -> list[str]:
    """Return what is wrong between the vehicles of a playbook, in words."""
    return [
        *_shared_system_ids(vehicles, mavlink),
        *_repeated_links(vehicles),
        *_differing_keys(vehicles),
        *_unfit_for_nodes(vehicles),
    ]


def _shared_system_ids(vehicles: Mapping[str, VehicleLink], mavlink: Mavlink) -> Iterator[str]:
    owner: dict[tuple[str, int], str] = {}
    for name, at in vehicles.items():
        if at.system_id == mavlink.system_id:
            yield f"{name} has system id {at.system_id}, which is this service's own: give one of them another"
        for link in at.links:
            other = owner.setdefault((link, at.system_id), name)
            if other != name:
                yield f"{other} and {name} are both system id {at.system_id} on {link}: give each its own"


def _repeated_links(vehicles: Mapping[str, VehicleLink]) -> Iterator[str]:
    for name, at in vehicles.items():
        if len(set(at.links)) != len(at.links):
            yield f"{name} has the same link twice: a fallback is another one"


def _unfit_for_nodes(vehicles: Mapping[str, VehicleLink]) -> Iterator[str]:
    first: dict[str, str] = {}
    for name, at in vehicles.items():
        if at.node is not None and at.fallback:
            yield f"{name} is on node {at.node} and has a fallback: a vehicle on a node has one link"
        for link in at.links:
            other = first.setdefault(link, name)
            if vehicles[other].node != at.node:
                yield f"{other} and {name} share {link} but not its node: a link is at one"


def _differing_keys(vehicles: Mapping[str, VehicleLink]) -> Iterator[str]:
    first: dict[str, str] = {}
    for name, at in vehicles.items():
        for link in at.links:
            other = first.setdefault(link, name)
            if vehicles[other].signing != at.signing:
                yield f"{other} and {name} share {link} but not its signing key: a link has one"
