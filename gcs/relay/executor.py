"""The relay executor: brings every receiver to its slot, wave after wave, from bearings alone.

It sees leases, observations and objections; it has no way to ask where a vehicle says it is.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamState
from gcs.bearings import BearingFeed, Observations, collect
from gcs.errors import HoldRequiredError
from gcs.relay.emission import EmissionControl
from gcs.relay.leg_flight import Announce, LegFlight, SetpointLease
from gcs.relay.locating import locate, transmitters_to_hear
from gcs.relay.records import ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.relay.states import IN_FLIGHT, ReceiverState, require_transition
from gcs.stop_monitor import SLOT, TURN, StopMonitor
from planner.errors import PlannerError
from planner.frames import FormationFrame
from planner.plan import Route
from planner.positioning import Fix
from planner.replan import replan

Objection = Callable[[str], str | None]
"""Says why a receiver must not move now, or None."""


class RelayExecutor:
    """Runs one relay plan, given as the records of its receivers; `announce` is told every change of one."""

    def __init__(
        self,
        records: Mapping[str, ReceiverRecord],
        transmitters: Mapping[str, complex],
        *,
        leases: Mapping[str, SetpointLease],
        feed: BearingFeed,
        emission: EmissionControl,
        frame: FormationFrame,
        clock: Clock,
        settings: RelaySettings,
        objection: Objection,
        announce: Announce,
    ) -> None:
        self.records = records
        self._places = dict(transmitters)
        self._place_sigma_m = dict.fromkeys(transmitters, 0.0)
        self._leases = leases
        self._feed = feed
        self._emission = emission
        self._frame = frame
        self._clock = clock
        self._settings = settings
        self._objection = objection
        self._announce = announce
        self._aborted: str | None = None

    @property
    def formed(self) -> bool:
        """Whether every receiver is PLACED."""
        return all(record.state is ReceiverState.PLACED for record in self.records.values())

    async def run(self) -> None:
        """Fly the waves one after another; return when all are PLACED or one could not go on.

        Every vehicle in flight is told to stop when this ends, however it ends.
        """
        try:
            routes = sorted((record.route for record in self.records.values()), key=lambda r: (r.wave, r.order))
            for _, wave in groupby(routes, key=lambda route: route.wave):
                flown = list(wave)
                async with asyncio.TaskGroup() as group:
                    for route in flown:
                        group.create_task(self._bring(self.records[route.receiver]))
                if any(self.records[route.receiver].state is not ReceiverState.PLACED for route in flown):
                    break
        finally:
            self._stop_all()

    def abort(self, reason: str) -> None:
        """Stop every receiver at once and end the relay."""
        self._aborted = reason
        self._stop_all()

    def _stop_all(self) -> None:
        for name, record in self.records.items():
            if record.state in IN_FLIGHT:
                self._leases[name].stop()

    async def _bring(self, record: ReceiverRecord) -> None:
        """Bring one receiver to its slot, or leave it HELD or in PILOT with the reason; the others hold with it."""
        try:
            with self._feed.listen(record.name) as observations:
                await self._fly_route(record, observations)
        except HoldRequiredError as hold:
            lease = self._leases[record.name]
            lease.stop()
            taken = lease.state is StreamState.PILOT
            self._enter(record, ReceiverState.PILOT if taken else ReceiverState.HELD, hold.reason)
            if self._aborted is None:
                self.abort(f"{record.name} is held: {hold.reason}")
        finally:
            self._emission.need(record.name, ())

    async def _fly_route(self, record: ReceiverRecord, observations: Observations) -> None:
        self._enter(record, ReceiverState.LOCATING)
        fix = await self._located(record.route, observations, self._settings.locate_samples, record.route.start)
        record.route = self._replanned(record.route, fix.position)
        place, covariance = fix.position, fix.covariance
        for number, leg in enumerate(record.route.legs, start=1):
            self._enter(record, ReceiverState[f"LEG_{number}"])
            self._emission.need(record.name, {leg.guide, *leg.stop_reference})
            rule = SLOT if number == len(record.route.legs) else TURN
            monitor = StopMonitor(leg, self._places, place, covariance, self._clock.now_s(), rule)
            await self._leg_flight(record, monitor, observations).fly()
            place, covariance = monitor.place()
        self._enter(record, ReceiverState.VERIFYING)
        await self._clock.sleep(self._settings.settle_s)
        fix = await self._located(record.route, observations, self._settings.verify_samples, record.route.target)
        off_m = self._verified_offset_m(record.route, fix)
        self._places[record.name] = fix.position  # where the next receivers will find their transmitter
        self._place_sigma_m[record.name] = _worst_sigma_m(fix.covariance)
        self._enter(record, ReceiverState.PLACED, f"bearings put it {off_m:.2f} m from {record.route.slot}")

    def _leg_flight(self, record: ReceiverRecord, monitor: StopMonitor, observations: Observations) -> LegFlight:
        return LegFlight(
            record,
            monitor,
            self._leases[record.name],
            observations,
            objection=lambda: self._forbidden(record.name),
            announce=self._announce,
            frame=self._frame,
            clock=self._clock,
            settings=self._settings,
        )

    def _forbidden(self, name: str) -> str | None:
        """Return why a receiver must not move now, or None. HoldRequiredError when it is not the service's to move."""
        if self._leases[name].state is StreamState.PILOT:
            raise HoldRequiredError("its mode was changed by the pilot, another station or a failsafe")
        if self._aborted is not None:
            raise HoldRequiredError(self._aborted)
        return self._objection(name)

    async def _located(self, route: Route, observations: Observations, samples: int, prior: complex) -> Fix:
        """Locate a receiver that hovers near `prior`. HoldRequiredError when bearings do not fix its place."""
        names = transmitters_to_hear(prior, route.transmitters, self._places)
        self._emission.need(route.receiver, names)
        observations.forget()
        heard = await collect(observations, samples, names, self._settings.give_up_s)
        if (objection := self._forbidden(route.receiver)) is not None:
            raise HoldRequiredError(objection)
        if len(heard) < samples:
            raise HoldRequiredError(
                f"only {len(heard)} of {samples} reports with bearings of {', '.join(sorted(names))}: "
                "check its sensor and the transmitters"
            )
        try:
            return locate(heard, {name: self._places[name] for name in sorted(names)}, self._place_sigma_m, prior)
        except PlannerError as error:
            raise HoldRequiredError(f"it could not be located: {error}") from error

    def _replanned(self, route: Route, located: complex) -> Route:
        off_m = abs(located - route.start)
        if off_m > self._settings.start_tolerance_m:
            raise HoldRequiredError(
                f"it was located {off_m:.1f} m from its start (more than {self._settings.start_tolerance_m:g} m): "
                "check the site frame, and which UAV stands where"
            )
        try:
            return replan(route, located, self._places, self._settings.min_separation_m)
        except PlannerError as error:
            raise HoldRequiredError(str(error)) from error

    def _verified_offset_m(self, route: Route, fix: Fix) -> float:
        """Return how far bearings put a receiver from its slot, m; HoldRequiredError when that is too far."""
        off_m = abs(fix.position - route.target)
        allowed_m = self._settings.placement_tolerance_m + 3.0 * _worst_sigma_m(fix.covariance)
        if off_m > allowed_m:
            raise HoldRequiredError(f"bearings put it {off_m:.1f} m from {route.slot} (allowed are {allowed_m:.1f} m)")
        return off_m

    def _enter(self, record: ReceiverRecord, state: ReceiverState, reason: str = "") -> None:
        require_transition(record.name, record.state, state)
        record.state, record.reason = state, reason
        self._announce(record)


def _worst_sigma_m(covariance: NDArray[np.float64]) -> float:
    return math.sqrt(float(np.linalg.eigvalsh(covariance)[-1]))
