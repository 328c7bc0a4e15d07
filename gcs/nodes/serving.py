"""The nodes of a run: a desk for those that its playbook names, with every vehicle given to its own."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Final

from drivers.bus.session import LiveBus
from drivers.clock import Clock
from drivers.mavlink.codec import Codec
from drivers.mavlink.transport import LinkAddress
from gcs.nodes.desk import NodeDesk, Say, Share
from gcs.nodes.messages import Assign, Command, Post
from gcs.nodes.ownership import NodeView, Ownership
from gcs.nodes.remote_link import RemoteLink
from gcs.nodes.remote_stream import RemoteStream
from gcs.nodes.tokens import FILE, Tokens
from gcs.playbook.schema import Playbook
from gcs.relay.settings import RelaySettings

GRANT_S: Final = 1.0
"""How long a node may move its vehicles after a beat of its own that the service has answered."""


def desk_of(playbook: Playbook, folder: Path, bus: LiveBus, clock: Clock, unix_ms: int, say: Say) -> NodeDesk:
    """Return the desk for the nodes of a playbook; it is not attached to the bus yet.

    A vehicle that an earlier service of the run gave on stays where it was given. ServiceError when tokens cannot be
    kept in the run's folder.
    """
    tokens = Tokens(folder / FILE, unix_ms)
    node_of = {name: tokens.last[name].node if name in tokens.last else node for name, node in playbook.nodes.items()}
    nodes = {node: NodeView() for node in sorted({*node_of.values(), *playbook.nodes.values()})}
    ownership = Ownership(tokens, GRANT_S, nodes)
    ownership.begin(node_of)
    desk = NodeDesk(bus, playbook.name, clock, ownership, partial(_assign, playbook), say)
    desk.shares |= {name: _share(playbook, name, desk, clock) for name in node_of}
    return desk


def _assign(playbook: Playbook, posts: dict[str, Post]) -> Assign:
    return Assign(
        posts=posts,
        grant_s=GRANT_S,
        station_id=playbook.mavlink.system_id,
        axis_azimuth_rad=playbook.site.frame.axis_azimuth_rad,
        reference=playbook.sensor.reference,
        gap_s=RelaySettings.of(playbook.flight, playbook.planner.min_separation_m).gap_s,
    )


def _share(playbook: Playbook, name: str, desk: NodeDesk, clock: Clock) -> Share:
    at = (playbook.vehicles or {})[name]

    def send(frame: bytes, urgent: bool) -> None:
        desk.send(name, Command(name, desk.held(name).token, 0, frame, urgent))

    link = RemoteLink(desk.held(name).node, LinkAddress.parse(at.link), Codec(playbook.mavlink.system_id), clock, send)
    signing = at.signing or playbook.mavlink.signing

    def post(token: int) -> Post:
        return Post(
            token=token,
            system_id=at.system_id,
            link=at.link,
            message_ids=sorted(link.wanted.message_ids),
            altitude_m=playbook.flight.altitude_m,
            speed_mps=playbook.flight.speed_mps,
            lease_s=playbook.flight.lease_s,
            autopilot=at.autopilot,
            key_file=None if signing is None else signing.key_file,
            key_variable=None if signing is None else signing.key_variable,
        )

    return Share(post, link, RemoteStream(name, desk, clock, at.link))


def shares_of(desk: NodeDesk | None) -> Mapping[str, Share]:
    """Return the vehicles on nodes; none where there are no nodes."""
    return {} if desk is None else desk.shares
