"""The setpoint stream of a vehicle at its node, as the service commands it: stop, fly a leg, take it, give it back."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from typing import Final, Protocol

from msgspec.structs import replace

from drivers.clock import Clock
from drivers.errors import SetpointError, VehicleError
from drivers.mavlink.setpoints import StreamState
from gcs.errors import ServiceError
from gcs.nodes.messages import Adopt, BringUp, Done, FlyLeg, HeldVehicle, LegNotes, Order, Refused, Release
from gcs.nodes.ownership import Held
from gcs.nodes.remote_leg import RemoteLeg, Told
from gcs.relay.leg_flight import LegFlight
from gcs.traced_monitor import MonitorNote, SetUp, Tell, TracedMonitor

ANSWER_S: Final = 3.0
"""An order that has not come to its node by then is not waited for."""
_LOOK_S: Final = 0.1

_numbers = partial(next, count(1))


class Office(Protocol):
    """Where the streams of all vehicles get their words out."""

    def held(self, vehicle: str) -> Held:
        """Return who has a vehicle, and what its grants say."""
        ...

    def send(self, vehicle: str, order: Order) -> None:
        """Send an order to the node that has a vehicle."""
        ...

    def grant_now(self, vehicle: str) -> None:
        """Send the node that has a vehicle its grants at once."""
        ...

    def lost(self, vehicle: str) -> str | None:
        """Return why the node that has a vehicle is lost, or None."""
        ...


@dataclass
class RemoteStream:
    """The stream of one vehicle, wherever its link is."""

    name: str
    office: Office
    clock: Clock
    link: str
    """Where it is, for errors."""
    guided: bool = field(default=False, init=False)
    """Whether it has been brought up, or taken as it flies."""
    to_pilot: int | None = field(default=None, init=False)
    _state: StreamState = field(default=StreamState.PILOT, init=False)
    _order: int = field(default=0, init=False)
    """The last order sent, ..."""
    _reached: int = field(default=0, init=False)
    """...and the last that came to the node."""
    _answers: dict[int, asyncio.Future[Done]] = field(default_factory=dict, init=False)
    _legs: dict[int, Told] = field(default_factory=dict, init=False)
    _flown: TracedMonitor | None = field(default=None, init=False)
    """The monitor of the leg that was flown last: it may be flown on with."""
    _since: list[MonitorNote] = field(default_factory=list, init=False)
    """What it has been told since."""

    @property
    def state(self) -> StreamState:
        """What it does, as its node told last; one whose node is lost does nothing."""
        return StreamState.SILENT if self.office.lost(self.name) is not None else self._state

    def renew(self, velocity_north_east_mps: complex) -> None:
        """Refuse: no setpoint crosses the bus."""
        raise SetpointError(f"{self.name}: {velocity_north_east_mps} m/s is its node's to command, on a leg")

    def stop(self) -> None:
        """Have it fly zero velocity, then be silent; a leg that it flies has ended."""
        self.office.held(self.name).stops += 1
        self.office.grant_now(self.name)

    def release(self) -> str | None:
        """Give the vehicle back to the service, by its node: it is the service's as soon as that says so."""
        if self.state is not StreamState.PILOT:
            return None
        if (lost := self.office.lost(self.name)) is not None:
            return f"its node is lost: {lost}"
        self._order = _numbers()
        self.office.send(self.name, Release(self.name, self.office.held(self.name).token, self._order))
        return "its node was asked, and releases it when it flies in its guided mode: see whether it does"

    async def run(self) -> None:
        """Last until cancelled: it runs at the node."""
        await asyncio.Event().wait()

    async def bring_up(self) -> None:
        """Bring the vehicle into guided flight and stream to it. VehicleError when that is refused or unanswered."""
        await self._guide(partial(BringUp, self.name))

    async def adopt(self, *, withheld: bool = False) -> None:
        """Stream to the vehicle as it flies; not in its guided mode, or `withheld`, it is its pilot's. VehicleError."""
        await self._guide(partial(Adopt, self.name, withheld=withheld))

    async def fly(self, flight: LegFlight) -> None:
        """Have a leg flown, and follow it to its end. HoldRequiredError when the receiver must hold."""
        monitor, held = flight.monitor, self.office.held(self.name)
        if not isinstance(monitor, TracedMonitor):
            raise ServiceError(f"{self.name}: a leg at a node needs a monitor that tells its notes")
        goes_on = monitor is self._flown
        made, since = (None, self._since) if goes_on else (SetUp.of(monitor), [])
        self._flown, self._since = None, []
        if isinstance(monitor.tell, _Keeping):
            monitor.tell = monitor.tell.first
        order = self._order = _numbers()
        told = self._legs[order] = Told(self.clock)
        leg = RemoteLeg(flight, monitor, held.node, told, lambda: self.office.lost(self.name), self._object)
        fly = FlyLeg(self.name, held.token, order, held.stops, flight.settings, made, since)
        arrived = False
        try:
            self.office.send(self.name, fly)
            await leg.follow()
            arrived = True
        finally:
            del self._legs[order]
            held.objection = ""
            if not arrived:
                self.stop()
        self._flown = monitor
        monitor.tell = _Keeping(monitor.tell, monitor.time_s, self._since)

    def setpoints_after(self) -> int | None:
        """Return how many setpoints it was sent while it was not the service's, by its node; None: it always was."""
        return self.to_pilot

    def take_beat(self, held: HeldVehicle) -> None:
        """Take in what its node's beat says of it."""
        self._reached = max(self._reached, held.order)
        self.to_pilot = self.to_pilot if held.to_pilot is None else held.to_pilot
        if held.order >= self._order and held.state is not None:
            self._state = held.state

    def take(self, report: Done | LegNotes | Refused) -> None:
        """Take in what its node reports of an order."""
        self._reached = max(self._reached, report.order)
        if isinstance(report, Done):
            self._state = report.state or self._state
            if (answer := self._answers.get(report.order)) is not None and not answer.done():
                answer.set_result(report)
        elif (told := self._legs.get(report.order)) is not None:
            if isinstance(report, LegNotes) and report.ended is not None:
                self._state = report.ended.state
            told.push(report)
        elif isinstance(report, Refused):
            self.take(Done(report.vehicle, report.token, report.order, problem=report.why))

    def _object(self, objection: str) -> None:
        held = self.office.held(self.name)
        if objection != held.objection:
            held.objection = objection
            self.office.grant_now(self.name)

    async def _guide(self, order: Callable[[int, int], BringUp | Adopt]) -> None:
        number = self._order = _numbers()
        answer = self._answers[number] = asyncio.get_running_loop().create_future()
        sent_s = self.clock.now_s()
        try:
            self.office.send(self.name, order(self.office.held(self.name).token, number))
            while not answer.done():
                self._require_reached(number, self.clock.now_s() - sent_s)
                tick = asyncio.ensure_future(self.clock.sleep(_LOOK_S))
                try:
                    await asyncio.wait((answer, tick), return_when=asyncio.FIRST_COMPLETED)
                finally:
                    tick.cancel()
        finally:
            del self._answers[number]
        done = answer.result()
        if done.problem:
            raise VehicleError(self.name, self.link, done.problem, done.way_out)
        self.guided = True

    def _require_reached(self, number: int, waited_s: float) -> None:
        if (lost := self.office.lost(self.name)) is not None:
            raise VehicleError(self.name, self.link, f"its node is lost: {lost}", "Have it taken over.")
        if waited_s > ANSWER_S and self._reached < number:
            raise VehicleError(
                self.name, self.link, f"its node has not answered for {waited_s:.0f} s", "Check the bus between them."
            )


@dataclass(frozen=True)
class _Keeping:
    """Takes the notes of a monitor between two legs; they are kept, timed from when it was made."""

    first: Tell
    made_s: float
    kept: list[MonitorNote]

    def __call__(self, note: MonitorNote) -> None:
        self.first(note)
        self.kept.append(replace(note, time_s=note.time_s - self.made_s))
