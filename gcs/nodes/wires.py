"""The links of a node: each opened once, for as long as somebody behind it is held, and gated by the tenure."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import DriverError, LinkError
from drivers.mavlink.codec import Codec, Message
from drivers.mavlink.link import Link, Setpoint, Subscription, open_link
from drivers.mavlink.signing import LinkSigner, Signing
from drivers.mavlink.signing_key import SigningKey
from drivers.mavlink.tlog import FrameLog
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.tasks import StartTask
from gcs.errors import leaves
from gcs.nodes.messages import Post
from gcs.nodes.tenure import Authority, Tenure

log = logging.getLogger(__name__)

LogOf = Callable[[LinkAddress], FrameLog]
OpenSigning = Callable[[], Awaitable[Signing]]
"""Opens what the signed links of a node share, once."""


@dataclass(frozen=True)
class GatedChannel:
    """A vehicle's link, as far as the tenure lets anything be sent to it at the moment it leaves."""

    vehicle: str
    link: Link
    tenure: Tenure
    clock: Clock

    @property
    def address(self) -> LinkAddress:
        """Where the vehicle is spoken to."""
        return self.link.address

    @property
    def heard_system_ids(self) -> frozenset[int]:
        """The systems whose autopilots have been heard here."""
        return self.link.heard_system_ids

    @property
    def contested_system_ids(self) -> frozenset[int]:
        """The system ids that two autopilots have claimed here lately."""
        return self.link.contested_system_ids

    def listen(self, subscription: Subscription) -> None:
        """Hand the wanted messages of one system's autopilot to its handler; LinkError when the system id is taken."""
        self.link.listen(subscription)

    def post(self, message: Message) -> None:
        """Queue an ordinary message."""
        if self._authority() is Authority.GRANTED:
            self.link.post(message)

    def post_urgent(self, message: Message) -> None:
        """Queue a command that stops the vehicle."""
        if self._authority() is not Authority.NONE:
            self.link.post_urgent(message)

    def post_setpoint(self, system_id: int, setpoint: Setpoint) -> None:
        """Queue a setpoint: a motion for as long as the vehicle is granted, a stop until it is let go."""
        held = self.tenure.holdings.get(self.vehicle)
        if held is None:
            return
        until_s = held.silent_from_s if setpoint.stops else held.until_s
        if self.clock.now_s() < until_s:
            self.link.post_setpoint(system_id, replace(setpoint, expires_s=min(setpoint.expires_s, until_s)))

    def drop_setpoint(self, system_id: int) -> None:
        """Forget a setpoint still waiting for the vehicle."""
        self.link.drop_setpoint(system_id)

    def _authority(self) -> Authority:
        return self.tenure.authority(self.vehicle, self.clock.now_s())


@dataclass
class _Wire:
    """One link that is open, and the vehicles behind it that are held."""

    link: Link
    closing: asyncio.Event
    closed: asyncio.Event
    held: set[str] = field(default_factory=set)
    vehicles: dict[tuple[str, int], Vehicle] = field(default_factory=dict)
    """Everybody that was ever behind it: a link hears each system only once."""


@dataclass
class Wires:
    """All links of a node. `start` runs what keeps them; `signing` opens what signed ones share."""

    tenure: Tenure
    clock: Clock
    log_of: LogOf
    signing: OpenSigning
    start: StartTask
    _open: dict[str, _Wire] = field(default_factory=dict)
    _opening: asyncio.Lock = field(default_factory=asyncio.Lock)

    async def open(self, name: str, post: Post, station_id: int) -> Vehicle:
        """Return a vehicle behind its link, which is opened where it is not open yet. LinkError when it cannot be."""
        async with self._opening:
            wire = self._open.get(post.link)
            if wire is not None and wire.closing.is_set():
                await wire.closed.wait()
                wire = None
            if wire is None:
                wire = await self._opened(post, station_id)
            wire.held.add(name)
        key = name, post.system_id
        if key not in wire.vehicles:
            channel = GatedChannel(name, wire.link, self.tenure, self.clock)
            wire.vehicles[key] = Vehicle(name, post.system_id, channel, self.clock)
        return wire.vehicles[key]

    async def close(self, name: str) -> None:
        """Let a vehicle go; a link with nobody behind it is closed."""
        for wire in [wire for wire in self._open.values() if name in wire.held]:
            wire.held.discard(name)
            if not wire.held:
                wire.closing.set()
                await wire.closed.wait()

    async def _opened(self, post: Post, station_id: int) -> _Wire:
        address = LinkAddress.parse(post.link)
        codec = Codec(station_id, signing=await self._signer(post))
        ready = asyncio.get_running_loop().create_future()
        closing, closed = asyncio.Event(), asyncio.Event()

        async def keep() -> None:
            try:
                async with open_link(address, codec, self.clock, self.log_of(address)) as link:
                    self._open[post.link] = _Wire(link, closing, closed)
                    ready.set_result(None)
                    await closing.wait()
            except* DriverError as failures:
                words = "; ".join(str(failure) for failure in leaves(failures))
                if ready.done():
                    log.error("%s has failed: %s", address, words)
                else:
                    ready.set_exception(LinkError(words))
            finally:
                self._open.pop(post.link, None)
                closed.set()

        self.start(keep())
        await ready
        return self._open[post.link]

    async def _signer(self, post: Post) -> LinkSigner | None:
        key = _key_of(post)
        return None if key is None else (await self.signing()).link(key, post.link)


def _key_of(post: Post) -> SigningKey | None:
    """Return the key that a vehicle's link is signed with on this machine. LinkError when it cannot be used."""
    if post.key_file is not None:
        return SigningKey.from_file(Path(post.key_file).expanduser())
    return None if post.key_variable is None else SigningKey.from_environment(post.key_variable)
