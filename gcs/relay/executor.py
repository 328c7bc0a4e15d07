"""The relay executor: brings every receiver to its slot, wave after wave, and holds them all when one has to hold.

It sees leases, observations and objections; it has no way to ask where a vehicle says it is. A vehicle that its pilot
has taken over is left alone from then on, and a transmitter among them is not trusted to stand any more.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from typing import Final, Protocol

from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamState
from drivers.tasks import background
from gcs.bearings import BearingFeed
from gcs.errors import HoldRequiredError, ServiceError
from gcs.relay.emission import EmissionControl
from gcs.relay.journey import Journey, Surroundings
from gcs.relay.leg_flight import Announce, SetpointLease
from gcs.relay.lookout import NoWayError
from gcs.relay.records import ReceiverRecord
from gcs.relay.rerouting import around_routes, bare_problem
from gcs.relay.schedule import Departure, hovering_beside, next_departure
from gcs.relay.settings import RelaySettings
from gcs.relay.standing import Standing
from gcs.relay.states import ENDED, IN_FLIGHT, ReceiverState
from gcs.relay.verification import verify
from gcs.traced_monitor import Trace, untraced
from planner.frames import FormationFrame
from planner.relay import RelayProblem

Work = Callable[[Journey], Awaitable[None]]
"""What is done for one receiver."""

Objection = Callable[[str], str | None]
"""Says why a vehicle must not move now, or None."""

WATCH_PERIOD_S: Final = 0.1
"""How often every vehicle's stream is looked at for a take-over."""

_TAKEN: Final = "its mode was changed by the pilot, another station or a failsafe"
_RELEASED: Final = "released: it hovers until the relay is resumed"


class ReleasableLease(SetpointLease, Protocol):
    """What the operator may do to a vehicle besides."""

    def release(self) -> str | None:
        """Give the vehicle back to the service; return why that cannot be yet and what to do, or None."""
        ...


class RelayExecutor:
    """Runs one relay plan, given as the records of its receivers.

    `announce` is told every change of a receiver, `say` what concerns the relay as a whole. Attended, it waits for the
    operator when it is held; unattended that ends it, unless the operator held it. `problem` says what new routes must
    keep to; without it the separation alone. `unverified` are receivers that an earlier service left PLACED or HELD:
    they are located first, in this order, and none of them counts as a transmitter before. ServiceError when the
    problem counts on north and the bearings do not, or the other way round.
    `bring` is how one is brought to its slot: only studies say another way.
    """

    def __init__(
        self,
        records: Mapping[str, ReceiverRecord],
        transmitters: Mapping[str, complex],
        *,
        leases: Mapping[str, ReleasableLease],
        feed: BearingFeed,
        emission: EmissionControl,
        frame: FormationFrame,
        clock: Clock,
        settings: RelaySettings,
        objection: Objection,
        announce: Announce,
        say: Callable[[str], None] = lambda _: None,
        problem: RelayProblem | None = None,
        trace: Trace = untraced,
        attended: bool = False,
        unverified: Sequence[str] = (),
        bring: Work = Journey.fly,
    ) -> None:
        self.records = records
        self.leases = leases
        self.standing = Standing(transmitters)
        self.objection = objection
        self.held: str | None = None
        """Why nobody flies until the operator resumes, or None."""
        self.taken: set[str] = set()
        """The vehicles that are not the service's to move, receivers and transmitters."""
        self.given_up: set[str] = set()
        """The receivers that are FAILED, and the transmitters that are not used any more."""
        self.unreached: dict[str, str] = {}
        """The vehicles that nobody speaks to now, and the lost link node of each."""
        self.ended = False
        self.waiting = False
        """Whether the relay waits for the operator's word."""
        self._feed = feed
        self._clock = clock
        self._settings = settings
        self._say = say
        self._attended = self._waits = attended
        routes = {name: record.route for name, record in records.items()}
        from_north = feed.reference == "true_north"
        problem = problem or bare_problem(
            routes, transmitters, settings.min_separation_m, heading_referenced=from_north
        )
        if problem.heading_referenced != from_north:
            raise ServiceError("the plan and the bearings must refer to the same: both to true_north, or both to body")
        problem = around_routes(problem, routes)
        self._around = Surroundings(self.standing, emission, frame, clock, settings, problem, announce, trace)
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._resumed: set[str] = set()
        self._unverified = list(unverified)
        self._bring_by = bring
        self._changed = asyncio.Event()

    @property
    def formed(self) -> bool:
        """Whether every receiver is PLACED, and found there."""
        return not self._unverified and all(record.state is ReceiverState.PLACED for record in self.records.values())

    async def run(self) -> None:
        """Fly the waves one after another; return when all are PLACED or FAILED, or the relay does not go on.

        Every vehicle in flight is told to stop when this ends, however it ends.
        """
        try:
            async with background(self._watch()):
                while not self.ended:
                    await self._go_on()
        finally:
            self.ended = True
            for name, record in self.records.items():
                if record.state in IN_FLIGHT:
                    self.leases[name].stop()

    async def _go_on(self) -> None:
        """Let fly who is due, or else wait for the operator, or end."""
        self.look()
        self._changed.clear()
        departure = None
        if self.held is None and (unverified := self._next_unverified()) is not None:
            await self._verify(unverified)
            return
        if self.held is None:
            departure = next_departure(self.records, self._resumed, self.standing, self._settings.min_separation_m)
        if departure is not None:
            await self._fly(departure)
        elif not self._waits or all(record.state in ENDED for record in self.records.values()):
            self.ended = True
        else:
            self.waiting = True
            self._say(f"waiting for the operator: {', or '.join(self.ways_out())}")
            await self._changed.wait()
            self.waiting = False

    def _next_unverified(self) -> ReceiverRecord | None:
        """Return who is located next of those that an earlier service left, or None when nobody is left to locate."""
        left = (self.records[name] for name in self._unverified)
        return next((record for record in left if record.state in (ReceiverState.PLACED, ReceiverState.HELD)), None)

    def ways_out(self) -> list[str]:
        """Return the commands of the operator that change something while the relay does not go on."""
        words = [f"takeover {node}" for node in sorted(set(self.unreached.values()))]
        words += [f"{verb} {name}" for name in self.blocking() for verb in ("release", "skip")]
        return [f"bearing-relay control {word}" for word in (*(words or ["resume"]), "abort")]

    def blocking(self) -> list[str]:
        """Return the vehicles that are their pilots' and have not been given up."""
        return sorted(self.taken - self.given_up)

    def users(self, name: str) -> list[str]:
        """Return the receivers on their way whose routes count on a transmitter."""
        return [
            user
            for user, record in self.records.items()
            if record.state not in ENDED and name in record.route.transmitters
        ]

    def hold(self, reason: str, *, wait: bool = False) -> list[str]:
        """Stop all that fly and leave them HELD; return who they are. `wait` for the operator even unattended."""
        flying = [record for record in self.records.values() if record.state in IN_FLIGHT]
        for record in flying:
            self.leases[record.name].stop()
        for name in list(self._tasks):
            self._cancel(name)
        for record in flying:
            self._around.enter(record, ReceiverState.HELD, reason)
        if self.held is None:
            self.held = reason
            self._say(f"the relay holds: {reason}")
        self._waits = self._waits or wait
        self._resumed.clear()
        self._changed.set()
        return [record.name for record in flying]

    def resume(self) -> list[str]:
        """Let every HELD receiver go on, located and re-planned from where it is; return those not told so before."""
        held = {name for name, record in self.records.items() if record.state is ReceiverState.HELD}
        told = sorted(held - self._resumed)
        self.held, self._waits, self._resumed = None, self._attended, held
        self._changed.set()
        return told

    def give_up(self, name: str, reason: str) -> None:
        """Do without a vehicle from now on: a receiver is FAILED and hovers, a transmitter is not used any more."""
        self.given_up.add(name)
        self.unreached.pop(name, None)
        self.standing.lose(name)
        self._cancel(name)
        record = self.records.get(name)
        if record is not None and record.state is not ReceiverState.FAILED:
            self.leases[name].stop()
            self._around.enter(record, ReceiverState.FAILED, reason)
        self._changed.set()

    def abort(self, reason: str) -> list[str]:
        """Stop all that fly at once and end the relay; return who flew."""
        self.ended = True
        return self.hold(reason)

    def lose_reach(self, node: str, names: Iterable[str], reason: str) -> None:
        """Hold: nobody speaks to these vehicles any more, their link node is lost. Where they went is not known.

        Those in flight may be anywhere afterwards; no transmitter among them is trusted before it is found again.
        """
        lost = set(names) - self.given_up
        self.unreached |= dict.fromkeys(lost, node)
        flying = [name for name in lost if name in self.records and self.records[name].state in IN_FLIGHT]
        self.hold(f"link node {node} is lost ({reason}), and with it {', '.join(sorted(lost)) or 'nobody'}")
        for name in flying:
            self.records[name].strayed = True
        for name in lost:
            self.standing.lose(name)
            record = self.records.get(name)
            if record is not None and record.state is ReceiverState.PLACED and name not in self._unverified:
                self._unverified.append(name)

    def regain_reach(self, names: Iterable[str]) -> None:
        """Count on vehicles again that another link node has taken over; those that stood are located first."""
        for name in set(names) & self.unreached.keys():
            del self.unreached[name]
            if name in self.standing.given and name not in self.taken | self.given_up:
                self.standing.restore(name)
        self._changed.set()

    def look(self) -> None:
        """Notice who was taken over by a pilot, and who was given back."""
        for name, lease in self.leases.items():
            taken = lease.state is StreamState.PILOT
            if taken and name not in self.taken:
                self._lose(name)
            elif not taken and name in self.taken:
                self._regain(name)

    async def _watch(self) -> None:
        while True:
            await self._clock.sleep(WATCH_PERIOD_S)
            self.look()

    def _lose(self, name: str) -> None:
        """Leave a vehicle to its pilot; the others hold when it was on its way or is needed as a transmitter."""
        record = self.records.get(name)
        on_its_way = record is not None and record.state not in ENDED
        needed = name not in self.given_up and (name in self._around.emission.on_air or bool(self.users(name)))
        self.taken.add(name)
        self.standing.lose(name)
        self._cancel(name)
        if record is None:
            self._say(f"{name}: {_TAKEN}")
        elif record.state is not ReceiverState.FAILED:
            record.strayed = True
            self._around.enter(record, ReceiverState.PILOT, _TAKEN)
        if on_its_way or needed:
            self.hold(f"{name} was taken over: {_TAKEN}")

    def _regain(self, name: str) -> None:
        self.taken.discard(name)
        record = self.records.get(name)
        if record is not None and record.state is ReceiverState.PILOT:
            record.off_plan = True
            self._around.enter(record, ReceiverState.HELD, _RELEASED)
        elif name in self.standing.given and name not in self.given_up:
            self.standing.restore(name)
            self._say(f"{name}: released: it is taken to stand at its place")
        self._changed.set()

    def _cancel(self, name: str) -> None:
        if (task := self._tasks.pop(name, None)) is not None:
            task.cancel()

    async def _fly(self, departure: Departure) -> None:
        async with asyncio.TaskGroup() as group:
            for record in departure.records:
                self._resumed.discard(record.name)
                self._tasks[record.name] = group.create_task(self._bring(record, alone=departure.alone))
        self._tasks.clear()

    async def _verify(self, record: ReceiverRecord) -> None:
        """Locate a receiver that an earlier service left."""

        async def located(journey: Journey) -> None:
            await verify(journey)
            self._unverified.remove(record.name)

        async with asyncio.TaskGroup() as group:
            self._tasks[record.name] = group.create_task(self._work_on(record, located, alone=True))
        self._tasks.clear()

    async def _bring(self, record: ReceiverRecord, *, alone: bool) -> None:
        """Bring one receiver to its slot, or leave it HELD, in PILOT or FAILED with the reason."""
        await self._work_on(record, self._bring_by, alone=alone)

    async def _work_on(self, record: ReceiverRecord, work: Work, *, alone: bool) -> None:
        """Do this for one receiver, or leave it HELD, in PILOT or FAILED with the reason."""
        try:
            with self._feed.listen(record.name) as observations:
                journey = Journey(
                    record,
                    self._around,
                    self.leases[record.name],
                    observations,
                    objection=lambda: self._forbidden(record.name),
                    again=record.state is ReceiverState.HELD,
                    hovering=hovering_beside(record.name, self.records) if alone else None,
                )
                await work(journey)
        except HoldRequiredError as problem:
            self._tasks.pop(record.name, None)  # it ends by itself
            self._halt(record, problem)
        finally:
            self._around.emission.need(record.name, ())

    def _halt(self, record: ReceiverRecord, problem: HoldRequiredError) -> None:
        """Stop a receiver that must not fly on, and the relay with it, unless it has no way without one given up."""
        lost = self.given_up & set(record.route.transmitters)
        self.leases[record.name].stop()
        if self.leases[record.name].state is StreamState.PILOT:
            self._lose(record.name)
        elif isinstance(problem, NoWayError) and lost:
            self.give_up(record.name, f"{', '.join(sorted(lost))} was given up, and without: {problem.reason}")
        else:
            self._around.enter(record, ReceiverState.HELD, problem.reason)
            self.hold(f"{record.name} is held: {problem.reason}")

    def _forbidden(self, name: str) -> str | None:
        """Return why a receiver must not move now, or None. HoldRequiredError when it is not the service's to move."""
        if self.leases[name].state is StreamState.PILOT:
            raise HoldRequiredError(_TAKEN)
        return self.objection(name) or self._unfit(self.records[name].route.transmitters)

    def _unfit(self, transmitters: Iterable[str]) -> str | None:
        """Return why a transmitter from the start is not to be flown by, or None; a beacon tells nothing of itself."""
        for name in transmitters:
            if name in self.standing.given and name in self.leases and (problem := self.objection(name)) is not None:
                return f"its transmitter {name}: {problem}"
        return None
