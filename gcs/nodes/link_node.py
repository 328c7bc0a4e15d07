"""A link node: holds vehicles for the service of a swarm, flies their legs, and lets them go when it is cut off."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.node_keys import NodeKeys
from drivers.bus.session import LiveBus
from drivers.clock import Clock, SystemClock
from drivers.mavlink.codec import MAGIC
from drivers.mavlink.signing import Signing, open_signing
from drivers.mavlink.tlog import FrameLog
from drivers.mavlink.transport import LinkAddress
from drivers.tasks import open_background
from gcs.nodes.held_vehicle import Holder
from gcs.nodes.messages import Assign, Beat, Post, Refused, Report, Telemetry, decode_grant, decode_order, encode
from gcs.nodes.tenure import BEAT_S, Authority, Tenure
from gcs.nodes.wires import OpenSigning, Wires
from gcs.takeovers import CountingLogs, FrameLogs, Takeovers

WATCH_S: Final = 0.05
"""How often it looks whose grant has run out: a leg that is flown notices by itself, to the millisecond."""
TELEMETRY_S: Final = 0.05

Say = Callable[[str], None]


class NoLogs:
    """Keeps no log of any link."""

    def of(self, _address: object) -> FrameLog:
        """Return a log that forgets."""
        return self

    def received(self, frame: bytes | bytearray) -> None:
        """Forget a frame that came in."""

    def sent(self, frame: bytes) -> None:
        """Forget a frame that was sent."""


@dataclass
class LinkNode:
    """One node, by its name, on the bus of a swarm. `logs` take down its links; `say` gets what an operator reads."""

    name: str
    swarm: str
    bus: LiveBus
    clock: Clock
    say: Say
    logs: FrameLogs = field(default_factory=NoLogs)
    life: int = field(default_factory=time.time_ns)
    holders: dict[str, Holder] = field(default_factory=dict, init=False)
    tenure: Tenure = field(init=False)
    _seen: dict[str, Authority] = field(default_factory=dict, init=False)
    """What might be sent to each vehicle that has been granted, when that was looked at last."""
    _wanted: dict[tuple[str, int], tuple[str, frozenset[int]]] = field(default_factory=dict, init=False)
    """By link and system id, whose frames they are, and which of them the service wants."""
    _said: set[str] = field(default_factory=set, init=False)
    _telemetry: defaultdict[str, list[bytes]] = field(default_factory=lambda: defaultdict(list), init=False)
    _assigning: asyncio.Lock = field(default_factory=asyncio.Lock, init=False)

    def __post_init__(self) -> None:
        self.tenure = Tenure(self.life)
        self._keys = NodeKeys(self.swarm, self.name)
        self._counted = CountingLogs(self.logs)
        self._takeovers = Takeovers(self._counted.setpoints)

    async def run(self) -> None:
        """Serve until cancelled; then every vehicle is stopped and let go."""
        swarm = SwarmKeys(self.swarm)
        async with contextlib.AsyncExitStack() as stack, open_background() as start:
            self._wires = Wires(self.tenure, self.clock, self._log_of, _opening(stack), start)
            self._start = start
            self.bus.subscribe(self._keys.grant, self._take_grant)
            self.bus.subscribe(self._keys.orders, self._take_order)
            self.bus.subscribe(swarm.every_bearings, self._take_bearings)
            self.bus.subscribe(swarm.every_clock_pong, self._take_pong)
            self.bus.declare_alive(self._keys.alive)
            try:
                for work in (self._beats(), self._watch(), self._pass_telemetry()):
                    start(work)
                await asyncio.Event().wait()
            finally:
                for holder in self.holders.values():
                    holder.lapse()
                await asyncio.sleep(0)  # the links' owners send it
                for holder in list(self.holders.values()):
                    await holder.close()

    def _take_grant(self, _key: str, payload: bytes) -> None:
        try:
            grant = decode_grant(payload)
        except msgspec.MsgspecError:
            self.tenure.refused["malformed"] += 1
            return
        for name in self.tenure.take(grant, self.clock.now_s()):
            if name in self.holders:
                self.holders[name].stop(grant.vehicles[name].stops)

    def _take_order(self, _key: str, payload: bytes) -> None:
        try:
            order = decode_order(payload)
        except msgspec.MsgspecError:
            self.tenure.refused["malformed"] += 1
            return
        if isinstance(order, Assign):
            self._start(self._assign(order))
            return
        why = self.tenure.obeys(order.vehicle, order.token, self.clock.now_s())
        if why is None:
            self.holders[order.vehicle].take(order)
            return
        if why not in self._said:
            self._said.add(why)
            self.say(f"refused: {why}")
        self._report(Refused(order.vehicle, order.token, order.order, why))

    async def _assign(self, assign: Assign) -> None:
        """Hold what is newly given; what was held by an older token is let go first."""
        async with self._assigning:
            for name, post in assign.posts.items():
                if name in self.holders and self.holders[name].post.token < post.token:
                    self.holders[name].lapse()
                    self.tenure.leave(name)
                    await self._let_go(name)
                if self.tenure.assign(name, post.token, assign.grant_s):
                    self.say(f"holds {name} at {post.link}")
                    self._hold(name, post, assign)

    def holder(self, name: str, post: Post, assign: Assign) -> Holder:
        """Return what will hold a vehicle."""
        return Holder(name, post, assign, self.tenure, self._wires, self.clock, self._report, self._takeovers)

    def _hold(self, name: str, post: Post, assign: Assign) -> None:
        holder = self.holder(name, post, assign)
        holder.clocks.ask_on(self.bus, SwarmKeys(self.swarm))
        self.holders[name] = holder
        self._wanted[str(LinkAddress.parse(post.link)), post.system_id] = name, frozenset(post.message_ids)

    async def _let_go(self, name: str) -> None:
        holder = self.holders.pop(name)
        self._seen.pop(name, None)
        await asyncio.sleep(0)  # the link's owner sends what it was told last
        await holder.close()

    async def _beats(self) -> None:
        while True:
            self._beat()
            await self.clock.sleep(BEAT_S)

    def _beat(self) -> None:
        vehicles = {name: holder.beat() for name, holder in self.holders.items()}
        stamp_ns = round(self.clock.now_s() * 1e9)
        beat = Beat(self.life, stamp_ns, vehicles, dict(self.tenure.refused))
        self.bus.put_latest(self._keys.beat, encode(beat), urgent=True)

    async def _watch(self) -> None:
        """Open the links of those granted, stop those whose grant has run out, and let them go in time."""
        while True:
            await self.clock.sleep(WATCH_S)
            for name, holder in list(self.holders.items()):
                await self._look_at(name, holder)

    async def _look_at(self, name: str, holder: Holder) -> None:
        before, now = self._seen.get(name), self.tenure.authority(name, self.clock.now_s())
        if before is None and now is Authority.NONE:
            return  # it has not been granted yet
        self._seen[name] = now
        if now is Authority.GRANTED and holder.vehicle is None and not holder.opening:
            holder.opening = True
            self._start(holder.open())
        elif now is Authority.STOPPING and before is Authority.GRANTED:
            self.say(f"{name}: its grant has run out: it is stopped")
            holder.lapse()
        elif now is Authority.NONE:
            self.say(f"{name} is let go")
            self.tenure.leave(name)
            await self._let_go(name)

    def _log_of(self, address: LinkAddress) -> FrameLog:
        return _PassingOn(self._counted.of(address), str(address), self.pass_on)

    def pass_on(self, address: str, frame: bytes | bytearray) -> None:
        """Let a frame of an autopilot wait for the service, where that wants it."""
        if frame[0] != MAGIC:
            self.tenure.refused["no MAVLink 2 frame"] += 1
            return
        wanted = self._wanted.get((address, frame[5]))
        if wanted is None or frame[6] != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return
        name, message_ids = wanted
        if int.from_bytes(frame[7:10], "little") in message_ids:
            self._telemetry[name].append(bytes(frame))

    async def _pass_telemetry(self) -> None:
        while True:
            await self.clock.sleep(TELEMETRY_S)
            if self._telemetry:
                self.bus.put_latest(self._keys.telemetry, encode(Telemetry(dict(self._telemetry))))
                self._telemetry.clear()

    def _take_bearings(self, key: str, payload: bytes) -> None:
        if (uav := uav_of(key)) in self.holders:
            self.holders[uav].feed.take(key, payload)

    def _take_pong(self, key: str, payload: bytes) -> None:
        if (uav := uav_of(key)) in self.holders:
            self.holders[uav].clocks.take(key, payload)

    def _report(self, report: Report) -> None:
        self.bus.put_reliably(self._keys.reports, encode(report))


@dataclass(frozen=True)
class _PassingOn:
    """A log of a link that passes on what was received, too."""

    log: FrameLog
    address: str
    pass_on: Callable[[str, bytes | bytearray], None]

    def received(self, frame: bytes | bytearray) -> None:
        """Take down a frame that came in."""
        self.log.received(frame)
        self.pass_on(self.address, frame)

    def sent(self, frame: bytes) -> None:
        """Take down a frame that was sent."""
        self.log.sent(frame)


def _opening(stack: contextlib.AsyncExitStack) -> OpenSigning:
    """Return what opens the signing of a node when it is first asked to; it is closed with the stack."""
    opened: list[Signing] = []

    async def open_once() -> Signing:
        if not opened:
            opened.append(await stack.enter_async_context(open_signing(SystemClock())))
        return opened[0]

    return open_once
