"""A bus closed to strangers: who may say and hear what, as zenoh's mutual TLS and access control.

Each party has one file, a zenoh configuration with its key and certificate inside, which any zenoh program can be
started with. The router's file holds the rights of all: whoever is not in it may connect and do nothing.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal

import msgspec
import zenoh

from drivers.bus.certificates import Authority, Identity
from drivers.bus.keys import NAME_PATTERN
from drivers.bus.rights import (
    OPERATOR,
    ROUTER,
    SERVICE,
    Rights,
    access_control,
    node_party,
    rights_of_all,
    rights_of_router,
    site_router,
    uav_party,
)
from drivers.bus.session import BusEndpoint
from drivers.errors import BusError
from drivers.strict_json import MalformedError, read_json

__all__ = [
    "OPERATOR",
    "ROUTER",
    "SERVICE",
    "KeyedEndpoint",
    "Rights",
    "access_control",
    "configurations",
    "host_of",
    "node_party",
    "rights_of_all",
    "site_router",
    "uav_party",
    "with_keys",
]

_LOOPBACK: Final = ("127.0.0.1", "localhost")
_ENDPOINT: Final = re.compile(r"tls/(?:\[(?P<six>[0-9a-fA-F:]+)\]|(?P<host>[A-Za-z0-9.-]+)):(?P<port>\d{1,5})")


def host_of(endpoint: str) -> str:
    """Return the host that a router's endpoint names. BusError when it is not written as tls/HOST:PORT."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or int(match["port"]) > 65535:
        raise BusError(f"{endpoint!r} is no endpoint that can be closed to strangers: write tls/HOST:PORT")
    return match["six"] or match["host"]


def configurations(
    swarm: str,
    uavs: Collection[str],
    endpoint: str,
    authority: Authority,
    nodes: Collection[str] = (),
    sites: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, str]:
    """Return the zenoh configuration of every party by its name, JSON: mutual TLS for all, the rights in the routers'.

    `sites` have routers of their own: at which endpoint, by name. Each connects to the router that all others reach.
    BusError when an endpoint or a name cannot be used.
    """
    all_rights = rights_of_all(swarm, uavs, nodes)
    of_sites = [rights_of_router(site_router(site), swarm) for site in sites]
    made = {ROUTER: _router(ROUTER, swarm, endpoint, authority, [*all_rights, *of_sites])}
    for site, at in sites.items():
        name = site_router(site)
        made[name] = _router(name, swarm, at, authority, [*all_rights, rights_of_router(ROUTER, swarm)])
        made[name]["connect"] = {"endpoints": [endpoint]}
        made[name]["transport"]["link"]["tls"] |= _proof("connect", authority.identity(name))
    for rights in all_rights:
        made[rights.name] = _configuration("client", endpoint, authority, authority.identity(rights.name))
    return {name: json.dumps(values, indent=1) for name, values in made.items()}


def _router(
    name: str, swarm: str, endpoint: str, authority: Authority, all_rights: Collection[Rights]
) -> dict[str, Any]:
    identity = authority.identity(name, tuple(dict.fromkeys((host_of(endpoint), *_LOOPBACK))))
    rest = {"access_control": access_control(swarm, all_rights), "metadata": {"swarm": swarm}}
    return _configuration("router", endpoint, authority, identity) | rest


def _configuration(mode: str, endpoint: str, authority: Authority, identity: Identity) -> dict[str, Any]:
    side = "listen" if mode == "router" else "connect"
    return {
        "mode": mode,
        side: {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "shared_memory": {"enabled": False},
            "link": {
                "protocols": ["tls"],
                "tls": {
                    "root_ca_certificate_base64": _text(authority.certificate),
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                    "close_link_on_expiration": False,  # a certificate that ends must not end a flight
                    **_proof(side, identity),
                },
            },
        },
    }


def _proof(side: str, identity: Identity) -> dict[str, str]:
    return {
        f"{side}_private_key_base64": _text(identity.key),
        f"{side}_certificate_base64": _text(identity.certificate),
    }


def _text(pem: bytes) -> str:
    return base64.b64encode(pem).decode("ascii")


@dataclass(frozen=True)
class KeyedEndpoint(BusEndpoint):
    """An endpoint at which a process takes part with the keys of one party."""

    keys: str = field(default="", repr=False)
    """That party's zenoh configuration, which holds a secret."""

    @property
    def closed(self) -> bool:
        """Whether nobody joins without keys."""
        return True

    def configuration(self) -> zenoh.Config:
        """Return the zenoh configuration: that of every endpoint, with the party's keys and the router's rights."""
        config, own = super().configuration(), json.loads(self.keys)
        for section, values in own["transport"]["link"].items():
            config.insert_json5(f"transport/link/{section}", json.dumps(values))
        if self.role == "router":
            config.insert_json5("access_control", json.dumps(own["access_control"]))
            config.insert_json5("connect/endpoints", json.dumps(read_json(self.keys, _KeyFile).connect.endpoints))
        return config

    @property
    def swarm(self) -> str | None:
        """The swarm that a router's keys are for; None where its file does not say it."""
        return read_json(self.keys, _KeyFile).metadata.swarm

    @property
    def parties(self) -> frozenset[str]:
        """Everybody to whom a router's file gives rights."""
        control = read_json(self.keys, _KeyFile).access_control
        return frozenset() if control is None else frozenset(subject.id for subject in control.subjects)


class _Link(msgspec.Struct):
    protocols: list[str]
    tls: dict[str, str | bool]


class _Transport(msgspec.Struct):
    link: _Link


class _Endpoints(msgspec.Struct):
    endpoints: list[str] = []


class _Metadata(msgspec.Struct):
    swarm: Annotated[str, msgspec.Meta(pattern=rf"^{NAME_PATTERN}$")] | None = None


class _Subject(msgspec.Struct):
    id: str


class _AccessControl(msgspec.Struct):
    enabled: bool = False
    default_permission: str = "allow"
    subjects: list[_Subject] = []

    @property
    def in_force(self) -> bool:
        """Whether nobody may do what is not said of him."""
        return self.enabled and self.default_permission == "deny" and bool(self.subjects)


class _KeyFile(msgspec.Struct):
    """What every file of keys holds."""

    mode: Literal["client", "router"]
    transport: _Transport
    connect: _Endpoints = msgspec.field(default_factory=_Endpoints)
    metadata: _Metadata = msgspec.field(default_factory=_Metadata)
    access_control: _AccessControl | None = None


def with_keys(endpoint: BusEndpoint, file: Path | None) -> BusEndpoint:
    """Return the endpoint as the party whose key file this is joins it; without a file as it is.

    BusError when the file cannot be read, is open to others, is no such file, or is for another role.
    """
    if file is None:
        return endpoint
    host_of(endpoint.endpoint)
    try:
        if file.stat().st_mode & 0o077:
            raise BusError(f"the keys in {file} can be read by others: chmod 600 it")
        keys = file.read_text(encoding="utf-8")
        known = read_json(keys, _KeyFile)
    except OSError as error:
        raise BusError(f"{file} cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, MalformedError):
        raise BusError(f"{file} holds no keys of a bus: make them with `bearing-relay keys init`") from None
    if known.mode != endpoint.role:
        raise BusError(f"{file} holds the keys of a {known.mode}, and those of a {endpoint.role} are needed")
    if known.mode == "router" and (known.access_control is None or not known.access_control.in_force):
        raise BusError(f"{file} says nobody's rights, or not to keep to them: then every party may do everything")
    return KeyedEndpoint(endpoint.endpoint, endpoint.role, keys)
