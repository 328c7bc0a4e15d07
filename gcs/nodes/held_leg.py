"""One leg flown at a node: the relay's own LegFlight on the vehicle's stream, and everything its monitor notes told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from msgspec.structs import replace

from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.mavlink.setpoints import SetpointStreamer, StreamState
from drivers.tasks import background
from gcs.bearings import BearingFeed
from gcs.errors import HoldRequiredError, leaves
from gcs.nodes.messages import FlyLeg, LegEnd, LegNotes, Report
from gcs.nodes.retelling import retell
from gcs.nodes.tenure import Authority, Tenure
from gcs.relay.leg_flight import LegFlight
from gcs.relay.records import ReceiverRecord
from gcs.traced_monitor import MonitorNote, SetUp, TracedMonitor
from planner.frames import FormationFrame
from planner.plan import Route

CUT_SHORT: Final = "it was told to stop"
CUT_OFF: Final = "cut off from the service: its node's grant has run out"
TAKEN: Final = "its mode was changed by the pilot, another station or a failsafe"
TELEMETRY_GAP_S: Final = 0.5
TOLD_EVERY_S: Final = 0.1


@dataclass
class HeldMonitor:
    """The stop monitor of a vehicle's leg, which may be flown on with: its notes go to whoever flies it."""

    monitor: TracedMonitor
    began_s: float
    """When it was made, by the node's clock: its notes are told by the time since then."""


@dataclass(frozen=True)
class GrantedLease:
    """A vehicle's stream, as far as its node may move it."""

    vehicle: str
    stream: SetpointStreamer
    tenure: Tenure
    clock: Clock

    @property
    def state(self) -> StreamState:
        """What the stream does."""
        return self.stream.state

    def renew(self, velocity_north_east_mps: complex) -> None:
        """Fly this velocity until the lease ends; nothing when the grant has run out."""
        if self.tenure.authority(self.vehicle, self.clock.now_s()) is Authority.GRANTED:
            self.stream.renew(velocity_north_east_mps)

    def stop(self) -> None:
        """Fly zero velocity, then be silent."""
        self.stream.stop()


@dataclass
class HeldLeg:
    """A leg that the service ordered. `report` sends what is told of it."""

    order: FlyLeg
    lease: GrantedLease
    feed: BearingFeed
    frame: FormationFrame
    report: Callable[[Report], None]
    _waiting: list[MonitorNote] = field(default_factory=list, init=False)
    _told: int = field(default=0, init=False)
    _began_s: float = field(default=0.0, init=False)
    _record: ReceiverRecord | None = field(default=None, init=False)

    def monitor(self, before: HeldMonitor | None) -> HeldMonitor | None:
        """Return the monitor to fly by: a new one, or that of the leg before, told what it is to know; None: gone."""
        now_s = self.lease.clock.now_s()
        if self.order.made is not None:
            made = monitor_of(self.order.made, now_s, self._note)
            return HeldMonitor(made, now_s)
        if before is None:
            return None
        before.monitor.tell = lambda _: None
        for note in self.order.since:
            retell(before.monitor, replace(note, time_s=note.time_s + before.began_s))
        before.monitor.tell = self._note
        return before

    async def fly(self, held: HeldMonitor, silent_for_s: Callable[[], float]) -> None:
        """Fly it to its end and report that; cancelled, it only stops."""
        self._began_s = held.began_s
        self._record = ReceiverRecord(_bare_route(self.order.vehicle, held.monitor))
        with self.feed.listen(self.order.vehicle) as observations:
            flight = LegFlight(
                self._record,
                held.monitor,
                self.lease,
                observations,
                objection=lambda: self._objection(silent_for_s()),
                announce=lambda _record: None,
                frame=self.frame,
                clock=self.lease.clock,
                settings=self.order.settings,
            )
            problem: str | None = CUT_SHORT
            try:
                async with background(self._telling()):
                    await flight.fly()
                problem = None
            except* (HoldRequiredError, DriverError) as problems:
                problem = next(str(leaf) for leaf in leaves(problems))
            finally:
                if problem is not None:
                    self.lease.stop()
        error_rad = self._record.legs[-1].stop_angle_error_rad
        self._tell(LegEnd(problem is None, problem or "", self.lease.state, error_rad))

    def _objection(self, silent_s: float) -> str | None:
        """Return why the vehicle must not move now, or None; HoldRequiredError when it is not the node's to move."""
        vehicle, tenure = self.order.vehicle, self.lease.tenure
        if tenure.authority(vehicle, self.lease.clock.now_s()) is not Authority.GRANTED:
            raise HoldRequiredError(CUT_OFF)
        if self.lease.state is StreamState.PILOT:
            raise HoldRequiredError(TAKEN)
        if silent_s > TELEMETRY_GAP_S:
            return f"no telemetry for {silent_s:.1f} s: check its link and autopilot"
        return tenure.holdings[vehicle].granted.objection or None

    def _note(self, note: MonitorNote) -> None:
        self._waiting.append(note)

    async def _telling(self) -> None:
        while True:
            await self.lease.clock.sleep(TOLD_EVERY_S)
            if self._waiting:
                self._tell(None)

    def _tell(self, ended: LegEnd | None) -> None:
        order, reason = self.order, "" if self._record is None else self._record.reason
        notes = [replace(note, time_s=note.time_s - self._began_s) for note in self._waiting]
        self._waiting.clear()
        self.report(LegNotes(order.vehicle, order.token, order.order, self._told, notes, reason, ended))
        self._told += len(notes)


def monitor_of(made: SetUp, time_s: float, tell: Callable[[MonitorNote], None]) -> TracedMonitor:
    """Return the monitor that a setup describes, as if it was made at `time_s`, telling its notes."""
    plain = made.monitor(time_s)
    return TracedMonitor(
        plain.leg,
        plain.transmitters,
        plain.start,
        plain.start_covariance,
        time_s,
        plain.rule,
        plain.place_sigma_m,
        plain.heading_referenced,
        plain.agility,
        plain.unrest,
        tell=tell,
    )


def _bare_route(vehicle: str, monitor: TracedMonitor) -> Route:
    leg = monitor.leg
    return Route(vehicle, "", 0, 0, "", leg.start, leg.end, (leg,))
