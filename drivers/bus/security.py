"""A bus closed to strangers: who may say and hear what, as zenoh's mutual TLS and access control.

Each party has one file, a zenoh configuration with its key and certificate inside, which any zenoh program can be
started with. The router's file holds the rights of all: whoever is not in it may connect and do nothing.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import zenoh

from drivers.bus.certificates import Authority, Identity
from drivers.bus.keys import SwarmKeys
from drivers.bus.node_keys import NodeKeys
from drivers.bus.session import BusEndpoint
from drivers.errors import BusError
from drivers.strict_json import MalformedError, read_json

SERVICE: Final = "service"
OPERATOR: Final = "operator"
ROUTER: Final = "router"
_LOOPBACK: Final = ("127.0.0.1", "localhost")
_ENDPOINT: Final = re.compile(r"tls/(?:\[(?P<six>[0-9a-fA-F:]+)\]|(?P<host>[A-Za-z0-9.-]+)):(?P<port>\d{1,5})")


@dataclass(frozen=True)
class Rights:
    """What one party may do, as key expressions; `name` is its certificate's common name."""

    name: str
    says: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    lives: tuple[str, ...] = ()
    """Where it tells that it lives..."""
    watches: tuple[str, ...] = ()
    """...and whose life it is told of."""


def node_party(node: str) -> str:
    """Return the common name of a link node, which no other kind of party can have."""
    return f"node.{node}"


def uav_party(uav: str) -> str:
    """Return the common name of a UAV, which no other kind of party can have."""
    return f"uav.{uav}"


def rights_of_all(swarm: str, uavs: Collection[str], nodes: Collection[str] = ()) -> list[Rights]:
    """Return the rights of everybody on the bus of a swarm.

    The service carries the swarm; it alone answers the operator, and the operator alone commands. A UAV speaks for
    itself, a link node for itself and to the service. Simulated sensors speak for all and belong to the service.
    """
    keys, every_node = SwarmKeys(swarm), NodeKeys(swarm)
    everything = (_whole(swarm), keys.state, keys.events, every_node.every_key)  # no wildcard matches the last three
    which_swarm = SwarmKeys("*").setup
    watched = (keys.setup, keys.events, keys.progress, keys.every_emission, which_swarm)
    answers = (*everything, which_swarm)
    return [
        Rights(
            SERVICE,
            says=everything,
            hears=everything,
            asks=(keys.every_emission,),
            answers=answers,
            watches=(every_node.alive,),
        ),
        Rights(OPERATOR, hears=everything, asks=(keys.control, *watched)),
        *(_rights_of_node(keys, NodeKeys(swarm, node)) for node in nodes),
        *(
            Rights(
                uav_party(uav),
                says=(keys.bearings(uav), keys.clock_pong(uav)),
                hears=(keys.clock_ping(uav), keys.emission(uav)),
                asks=(keys.emission(uav),),
            )
            for uav in uavs
        ),
    ]


def _rights_of_node(keys: SwarmKeys, own: NodeKeys) -> Rights:
    return Rights(
        node_party(own.node),
        says=(own.beat, own.reports, own.telemetry, keys.every_clock_ping),
        hears=(own.grant, own.orders, keys.every_bearings, keys.every_clock_pong),
        answers=(own.reports,),
        lives=(own.alive,),
    )


def access_control(swarm: str, all_rights: Collection[Rights]) -> dict[str, Any]:
    """Return zenoh's `access_control` section for the router of a swarm. What is not allowed is denied.

    Everybody may learn what others in the swarm subscribe to and answer: zenoh needs it to find its ways.
    """
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for rights in all_rights:
        own = list(_rules(rights, declared=(_whole(swarm), NodeKeys(swarm).every_key)))
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [rights.name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": rights.name, "cert_common_names": [rights.name]} for rights in all_rights],
        "policies": policies,
    }


def _rules(rights: Rights, declared: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    """Yield the rules of one party, as the router sees it: ingress is what comes from the party."""
    wanted = (
        ("says", "ingress", ["put", "delete"], rights.says),
        ("listens", "ingress", ["declare_subscriber"], rights.hears),
        ("asks", "ingress", ["query"], rights.asks),
        ("answers", "ingress", ["declare_queryable", "reply"], rights.answers),
        ("hears", "egress", ["put", "delete"], rights.hears),
        ("is asked", "egress", ["query"], rights.answers),
        ("is answered", "egress", ["reply"], rights.asks),
        ("is told", "egress", ["declare_subscriber", "declare_queryable"], declared),
        ("lives", "ingress", ["liveliness_token"], rights.lives),
        ("watches", "ingress", ["declare_liveliness_subscriber", "liveliness_query"], rights.watches),
        ("is told who lives", "egress", ["liveliness_token"], rights.watches),
    )
    for what, flow, messages, expressions in wanted:
        if expressions:
            yield {
                "id": f"{rights.name} {what}",
                "permission": "allow",
                "flows": [flow],
                "messages": messages,
                "key_exprs": list(expressions),
            }


def host_of(endpoint: str) -> str:
    """Return the host that a router's endpoint names. BusError when it is not written as tls/HOST:PORT."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or int(match["port"]) > 65535:
        raise BusError(f"{endpoint!r} is no endpoint that can be closed to strangers: write tls/HOST:PORT")
    return match["six"] or match["host"]


def configurations(
    swarm: str, uavs: Collection[str], endpoint: str, authority: Authority, nodes: Collection[str] = ()
) -> dict[str, str]:
    """Return the zenoh configuration of every party by its name, JSON: mutual TLS for all, the rights in the router's.

    BusError when the endpoint or a name cannot be used.
    """
    host, all_rights = host_of(endpoint), rights_of_all(swarm, uavs, nodes)
    router = authority.identity(ROUTER, tuple(dict.fromkeys((host, *_LOOPBACK))))
    made = {ROUTER: _configuration("router", endpoint, authority.certificate, router)}
    made[ROUTER]["access_control"] = access_control(swarm, all_rights)
    for rights in all_rights:
        identity = authority.identity(rights.name)
        made[rights.name] = _configuration("client", endpoint, authority.certificate, identity)
    return {name: json.dumps(values, indent=1) for name, values in made.items()}


def _configuration(mode: str, endpoint: str, authority: bytes, identity: Identity) -> dict[str, Any]:
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
                    "root_ca_certificate_base64": _text(authority),
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                    "close_link_on_expiration": False,  # a certificate that ends must not end a flight
                    f"{side}_private_key_base64": _text(identity.key),
                    f"{side}_certificate_base64": _text(identity.certificate),
                },
            },
        },
    }


def _whole(swarm: str) -> str:
    """Return the key expression of a whole swarm, but for what begins with @."""
    return SwarmKeys(swarm).progress.removesuffix("relay/progress") + "**"


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
        return config


class _Link(msgspec.Struct):
    protocols: list[str]
    tls: dict[str, str | bool]


class _Transport(msgspec.Struct):
    link: _Link


class _KeyFile(msgspec.Struct):
    """What every file of keys holds."""

    mode: Literal["client", "router"]
    transport: _Transport
    access_control: dict[str, Any] | None = None


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
    if known.mode == "router" and not known.access_control:
        raise BusError(f"{file} says nobody's rights: a router without them lets every party do everything")
    return KeyedEndpoint(endpoint.endpoint, endpoint.role, keys)
