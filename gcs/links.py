"""The links of a run: every physical link once, signed and recorded as asked for, and each vehicle on its own.

Links at link nodes are opened there; the service has its end of them here.
"""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Final, Protocol

from drivers.clock import Clock, SystemClock
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import Link, open_link
from drivers.mavlink.link_status import LinkStatus
from drivers.mavlink.redundant import RedundantLink
from drivers.mavlink.signing import LinkSigner, Signing, open_signing
from drivers.mavlink.signing_key import SigningKey
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.sitl import Sitl
from gcs.errors import ServiceError
from gcs.nodes.desk import Share
from gcs.playbook import links as written
from gcs.playbook.schema import Playbook
from gcs.takeovers import FrameLogs

NO_SHARES: Final[Mapping[str, Share]] = MappingProxyType({})
ANY_PORT: Final = 0
"""A port of the link's own, whichever is free."""


class Watched(Protocol):
    """A link that tells how it fares."""

    def status(self, now_s: float) -> LinkStatus:
        """Return how it fares by now."""
        ...


@dataclass(frozen=True)
class FleetLinks:
    """The vehicles of a run by name, and the links they are behind."""

    vehicles: dict[str, Vehicle] = field(default_factory=dict)
    behind: dict[Watched, list[str]] = field(default_factory=dict)
    """Every physical link, and the names of the vehicles that can be reached over it."""

    def statuses(self, now_s: float) -> list[tuple[str, LinkStatus]]:
        """Return how each link fares, with the names of the vehicles behind it."""
        return [(", ".join(names), link.status(now_s)) for link, names in self.behind.items()]


@dataclass(frozen=True)
class Way:
    """How one vehicle is reached: its links, the preferred one first, and the key they are signed with."""

    system_id: int
    addresses: tuple[LinkAddress, ...]
    signing: written.Signing | None


@contextlib.asynccontextmanager
async def open_links(
    playbook: Playbook,
    clock: Clock,
    sitl: Sitl | None,
    tlogs: FrameLogs | None = None,
    shares: Mapping[str, Share] = NO_SHARES,
) -> AsyncIterator[FleetLinks]:
    """Open every link of the playbook, or one for each vehicle to be simulated; yield the vehicles on them.

    `shares` are those on link nodes, whose links are opened there. LinkError when a link cannot be opened or its
    signing key cannot be used; ServiceError when a vehicle is on a node and no nodes are served.
    """
    _require_shares(playbook, shares)
    ways, fleet, opened = _ways(playbook, sitl), FleetLinks(), dict[LinkAddress, Link]()
    async with contextlib.AsyncExitStack() as stack:
        signing = await _signing({name: way for name, way in ways.items() if name not in shares}, stack)
        for name, way in ways.items():
            if name in shares:
                fleet.behind[shares[name].link] = [name]
                fleet.vehicles[name] = Vehicle(name, way.system_id, shares[name].link, clock)
                continue
            own: list[Link] = []
            for address in way.addresses:
                link = None if address.port == ANY_PORT else opened.get(address)
                if link is None:
                    codec = Codec(playbook.mavlink.system_id, signing=_signer(signing, way, address))
                    frame_log = None if tlogs is None else tlogs.of(name if address.port == ANY_PORT else address)
                    link = await stack.enter_async_context(open_link(address, codec, clock, frame_log))
                    opened[address] = link
                own.append(link)
                fleet.behind.setdefault(link, []).append(name)
            channel = own[0] if len(own) == 1 else RedundantLink(way.system_id, own, clock)
            fleet.vehicles[name] = Vehicle(name, way.system_id, channel, clock)
        yield fleet


def _require_shares(playbook: Playbook, shares: Mapping[str, Share]) -> None:
    if missing := sorted(playbook.nodes.keys() - shares.keys()):
        raise ServiceError(
            f"{', '.join(missing)} is on a link node: that takes `bearing-relay fly`, and the nodes running"
        )


def _ways(playbook: Playbook, sitl: Sitl | None) -> Mapping[str, Way]:
    """Return how each vehicle is reached; simulated ones on loopback, at the port their simulator speaks to."""
    if playbook.vehicles is None:
        return {
            name: Way(system_id, (_loopback(ANY_PORT if sitl is None else sitl.port(system_id)),), None)
            for system_id, name in enumerate(playbook.uavs, start=1)
        }
    return {
        name: Way(at.system_id, tuple(map(LinkAddress.parse, at.links)), at.signing or playbook.mavlink.signing)
        for name, at in playbook.vehicles.items()
    }


def _loopback(port: int) -> LinkAddress:
    return LinkAddress("udpin", "127.0.0.1", port)


async def _signing(ways: Mapping[str, Way], stack: contextlib.AsyncExitStack) -> Signing | None:
    """Open what the signed links share, where any is signed. The machine's own time stamps them, never a simulated."""
    if all(way.signing is None for way in ways.values()):
        return None
    return await stack.enter_async_context(open_signing(SystemClock()))


def _signer(signing: Signing | None, way: Way, address: LinkAddress) -> LinkSigner | None:
    if signing is None or way.signing is None:
        return None
    if way.signing.key_file is not None:
        key = SigningKey.from_file(Path(way.signing.key_file).expanduser())
    else:
        key = SigningKey.from_environment(way.signing.key_variable or "")
    return signing.link(key, str(address))
