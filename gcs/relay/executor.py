"""The relay executor: brings every receiver to its slot, wave after wave, from bearings alone.

It sees leases, observations and objections; it has no way to ask where a vehicle says it is.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamState
from gcs.bearings import BearingFeed, Observation, Observations, collect
from gcs.errors import HoldRequiredError
from gcs.guidance import SpeedLimits, leg_velocity
from gcs.relay.emission import EmissionControl
from gcs.relay.records import LegRecord, ReceiverRecord
from gcs.relay.states import IN_FLIGHT, ReceiverState, require_transition
from gcs.stop_monitor import SLOT, TURN, StopMonitor
from planner.angles import wrap
from planner.errors import PlannerError
from planner.frames import FormationFrame
from planner.plan import Leg, Route
from planner.positioning import Fix, locate_by_bearings
from planner.replan import replan


class SetpointLease(Protocol):
    """What the executor may do to a vehicle."""

    @property
    def state(self) -> StreamState:
        """Whether setpoints leave now; PILOT when somebody else has the vehicle."""
        ...

    def renew(self, velocity_north_east_mps: complex) -> None:
        """Fly this velocity until the lease ends."""
        ...

    def stop(self) -> None:
        """Fly zero velocity, then be silent."""
        ...


@dataclass(frozen=True)
class RelaySettings:
    """How the relay is flown."""

    limits: SpeedLimits = field(default_factory=SpeedLimits)
    min_separation_m: float = 5.0
    locate_samples: int = 10
    verify_samples: int = 20
    placement_tolerance_m: float = 3.0
    start_tolerance_m: float = 20.0
    gap_s: float = 0.5
    """Without a usable bearing for this long: zero velocity."""
    give_up_s: float = 5.0
    """Without one for this long: HELD."""

    def longest_leg_s(self, leg: Leg) -> float:
        """Return the time after which a leg has gone wrong, s."""
        return 30.0 + 3.0 * leg.length_m / self.limits.speed_mps


Announce = Callable[[ReceiverRecord], None]
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

        Every vehicle is told to stop when this ends, however it ends.
        """
        try:
            routes = sorted((record.route for record in self.records.values()), key=lambda r: (r.wave, r.order))
            for _, wave in groupby(routes, key=lambda route: route.wave):
                flown = list(wave)
                self._emission.set_on_air({name for route in flown for name in route.transmitters})
                async with asyncio.TaskGroup() as group:
                    for route in flown:
                        group.create_task(self._bring(self.records[route.receiver]))
                if any(self.records[route.receiver].state is not ReceiverState.PLACED for route in flown):
                    break
        finally:
            for name, record in self.records.items():
                if record.state in IN_FLIGHT:
                    self._leases[name].stop()
            self._emission.set_on_air(())

    def abort(self, reason: str) -> None:
        """Hold every receiver where it is and end the relay."""
        self._aborted = reason
        for name, record in self.records.items():
            if record.state in IN_FLIGHT:
                self._leases[name].stop()

    async def _bring(self, record: ReceiverRecord) -> None:
        """Bring one receiver to its slot, or leave it HELD or in PILOT with the reason."""
        try:
            with self._feed.listen(record.name) as observations:
                await self._fly_route(record, observations)
        except HoldRequiredError as hold:
            self._leases[record.name].stop()
            taken = self._leases[record.name].state is StreamState.PILOT
            self._enter(record, ReceiverState.PILOT if taken else ReceiverState.HELD, hold.reason)
            if self._aborted is None:
                self.abort(f"{record.name} is held: {hold.reason}")

    async def _fly_route(self, record: ReceiverRecord, observations: Observations) -> None:
        self._enter(record, ReceiverState.LOCATING)
        fix = await self._locate(record.route, observations, self._settings.locate_samples, record.route.start)
        record.route = self._replanned(record.route, fix.position)
        place, covariance = fix.position, fix.covariance
        for number, leg in enumerate(record.route.legs, start=1):
            self._enter(record, ReceiverState[f"LEG_{number}"])
            last = number == len(record.route.legs)
            monitor = StopMonitor(leg, self._places, place, covariance, self._clock.now_s(), SLOT if last else TURN)
            await self._fly_leg(record, leg, monitor, observations)
            place, covariance = monitor.place()
        self._enter(record, ReceiverState.VERIFYING)
        fix = await self._locate(record.route, observations, self._settings.verify_samples, record.route.target)
        self._verify(record.route, fix)
        self._places[record.name] = fix.position  # where the next receivers will find their transmitter
        self._enter(record, ReceiverState.PLACED)

    async def _fly_leg(
        self, record: ReceiverRecord, leg: Leg, monitor: StopMonitor, observations: Observations
    ) -> None:
        """Fly one leg until its stop condition holds. HoldRequiredError when it must not go on."""
        settings = self._settings
        flown = LegRecord(leg, started_s=self._clock.now_s())
        record.legs.append(flown)
        deadline_s = flown.started_s + settings.longest_leg_s(leg)
        usable_s = flown.started_s
        angle_errors: list[float] = []
        while True:
            observation = await observations.next(settings.gap_s)
            now_s = self._clock.now_s()
            self._require_ours(record.name)
            problem = self._objection(record.name) or _unusable(leg, observation, settings.gap_s)
            if problem is None and observation is not None:
                usable_s = now_s
                monitor.observe(observation.captured_s, observation.directions_rad, observation.sigma_rad)
                if monitor.contradicted:
                    raise HoldRequiredError(f"{monitor.outliers} bearings contradict the leg: check its sensor")
                flown.measured_angle_rad = _measured(leg, observation)
                arrived = monitor.arrived(now_s)
                if not monitor.dwelling:
                    angle_errors.clear()
                angle_errors.append(wrap(flown.measured_angle_rad - leg.stop_angle_rad))
                if arrived:
                    break
                self._steer(record, monitor, now_s)
            elif problem is not None:
                self._suspend(record, monitor, problem)
                if now_s - usable_s >= settings.give_up_s:
                    raise HoldRequiredError(f"{problem} (for {now_s - usable_s:.1f} s)")
            if now_s > deadline_s:
                raise HoldRequiredError(f"the leg took longer than {settings.longest_leg_s(leg):.0f} s")
        self._leases[record.name].stop()
        flown.estimate = monitor.estimate(now_s)
        flown.ended_s = now_s
        flown.stop_angle_error_rad = sum(angle_errors) / len(angle_errors)

    def _steer(self, record: ReceiverRecord, monitor: StopMonitor, now_s: float) -> None:
        """Renew the lease with the velocity that the angles ask for."""
        estimate = monitor.estimate(now_s)
        along_mps, across_mps = leg_velocity(estimate, self._settings.limits)
        self._leases[record.name].renew(self._frame.to_site(monitor.course * complex(along_mps, across_mps)))
        monitor.commanded(now_s, along_mps, across_mps)
        record.legs[-1].estimate = estimate
        self._say(record, "")

    def _suspend(self, record: ReceiverRecord, monitor: StopMonitor, problem: str) -> None:
        """Zero velocity while the problem lasts."""
        self._leases[record.name].stop()
        monitor.commanded(self._clock.now_s(), 0.0, 0.0)
        self._say(record, f"{problem}: zero velocity")

    def _say(self, record: ReceiverRecord, reason: str) -> None:
        """Announce a new reason, once."""
        if record.reason != reason:
            record.reason = reason
            self._announce(record)

    def _require_ours(self, name: str) -> None:
        """Return while the receiver is the service's to move; HoldRequiredError when it is not."""
        if self._leases[name].state is StreamState.PILOT:
            raise HoldRequiredError("its mode was changed by the pilot, another station or a failsafe")
        if self._aborted is not None:
            raise HoldRequiredError(self._aborted)

    async def _locate(self, route: Route, observations: Observations, samples: int, prior: complex) -> Fix:
        """Locate a hovering receiver from the transmitters on the air. HoldRequiredError when they do not fix it."""
        heard = await collect(observations, samples, route.transmitters, self._settings.give_up_s)
        self._require_ours(route.receiver)
        if (objection := self._objection(route.receiver)) is not None:
            raise HoldRequiredError(objection)
        if len(heard) < samples:
            raise HoldRequiredError(
                f"only {len(heard)} of {samples} reports with bearings of {', '.join(route.transmitters)}: "
                "check its sensor and the transmitters"
            )
        places = {name: self._places[name] for name in route.transmitters}
        directions = {name: _mean_direction([o.directions_rad[name] for o in heard]) for name in places}
        sigma = {name: heard[-1].sigma_rad[name] / math.sqrt(samples) for name in places}
        try:
            return locate_by_bearings(directions, places, sigma, prior=prior)
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

    def _verify(self, route: Route, fix: Fix) -> None:
        off_m = abs(fix.position - route.target)
        allowed_m = self._settings.placement_tolerance_m + 3.0 * _worst_sigma_m(fix.covariance)
        if off_m > allowed_m:
            raise HoldRequiredError(f"bearings put it {off_m:.1f} m from {route.slot} (allowed are {allowed_m:.1f} m)")

    def _enter(self, record: ReceiverRecord, state: ReceiverState, reason: str = "") -> None:
        require_transition(record.name, record.state, state)
        record.state, record.reason = state, reason
        self._announce(record)


def _unusable(leg: Leg, observation: Observation | None, gap_s: float) -> str | None:
    """Return why an observation cannot steer this leg, in words, or None."""
    if observation is None:
        return f"no bearing report from its sensor for {gap_s:g} s"
    missing = {leg.guide, *leg.stop_reference} - observation.directions_rad.keys()
    return f"it does not hear {', '.join(sorted(missing))}" if missing else None


def _measured(leg: Leg, observation: Observation) -> float:
    first, second = (observation.directions_rad[name] for name in leg.stop_reference)
    return wrap(second - first)


def _mean_direction(directions_rad: list[float]) -> float:
    return math.atan2(sum(map(math.sin, directions_rad)), sum(map(math.cos, directions_rad)))


def _worst_sigma_m(covariance: NDArray[np.float64]) -> float:
    return math.sqrt(float(np.linalg.eigvalsh(covariance)[-1]))
