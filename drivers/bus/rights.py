"""Who may say and hear what on the bus of a swarm, as zenoh's access control."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, Final

from drivers.bus.keys import SwarmKeys
from drivers.bus.node_keys import NodeKeys
from drivers.bus.refusals import refusals_key

SERVICE: Final = "service"
OPERATOR: Final = "operator"
ROUTER: Final = "router"


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


def site_router(site: str) -> str:
    """Return the common name of the router of a site, which no other kind of party can have."""
    return f"{ROUTER}.{site}"


def rights_of_all(swarm: str, uavs: Collection[str], nodes: Collection[str] = ()) -> list[Rights]:
    """Return the rights of everybody on the bus of a swarm.

    The service carries the swarm; it alone answers the operator, and the operator alone commands. A UAV speaks for
    itself, a link node for itself and to the service. Simulated sensors speak for all and belong to the service.
    """
    keys, every_node = SwarmKeys(swarm), NodeKeys(swarm)
    everything, refusals = _everything(swarm), refusals_key(swarm)
    which_swarm = SwarmKeys("*").setup
    watched = (keys.setup, keys.events, keys.progress, keys.every_emission, which_swarm)
    answers = (*everything, which_swarm)
    return [
        Rights(
            SERVICE,
            says=everything,
            hears=(*everything, refusals),
            asks=(keys.every_emission, keys.every_sensor_fault),
            answers=answers,
            watches=(every_node.alive,),
        ),
        Rights(OPERATOR, hears=(*everything, refusals), asks=(keys.control, *watched)),
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


def rights_of_router(name: str, swarm: str) -> Rights:
    """Return the rights of another router: it passes on what its own parties may say and hear, and judges that."""
    passed_on, alive = _passed_on(swarm), (NodeKeys(swarm).alive,)
    return Rights(name, passed_on, passed_on, passed_on, passed_on, alive, alive)


def access_control(swarm: str, all_rights: Collection[Rights]) -> dict[str, Any]:
    """Return zenoh's `access_control` section for the router of a swarm. What is not allowed is denied.

    Everybody may learn what others in the swarm subscribe to and answer: zenoh needs it to find its ways.
    """
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for rights in all_rights:
        own = list(_rules(rights, declared=_passed_on(swarm)))
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


def _everything(swarm: str) -> tuple[str, ...]:
    """Return the key expressions of all that is said in a swarm, but by its routers: one does not match the others."""
    keys = SwarmKeys(swarm)
    return _whole(swarm), keys.state, keys.events, NodeKeys(swarm).every_key


def _passed_on(swarm: str) -> tuple[str, ...]:
    """Return the key expressions of all that routers pass on, and of what they tell themselves."""
    return *_everything(swarm), SwarmKeys("*").setup, refusals_key(swarm)


def _whole(swarm: str) -> str:
    """Return the key expression of a whole swarm, but for what begins with @."""
    return SwarmKeys(swarm).progress.removesuffix("relay/progress") + "**"
