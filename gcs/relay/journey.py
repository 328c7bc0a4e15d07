"""The journey of one receiver to its slot: located, flown leg by leg, verified. All of it from bearings alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from gcs.bearings import Observations
from gcs.errors import HoldRequiredError
from gcs.relay.emission import EmissionControl
from gcs.relay.leg_flight import Announce, LegFlight, SetpointLease
from gcs.relay.lookout import Lookout, NoWayError
from gcs.relay.placing import require_in_slot, worth_trimming
from gcs.relay.records import ReceiverRecord
from gcs.relay.rerouting import reroute
from gcs.relay.settings import RelaySettings
from gcs.relay.standing import STANDING_SIGMA_M, Standing
from gcs.relay.states import ReceiverState, require_transition
from gcs.stop_monitor import SLOT, TURN, StopMonitor
from gcs.traced_monitor import Trace, TracedMonitor, untraced
from planner.errors import PlannerError
from planner.frames import FormationFrame
from planner.plan import Route
from planner.positioning import Fix
from planner.relay import RelayProblem
from planner.replan import replan

Reals = NDArray[np.float64]

COMING_TO_REST_S: Final = 3.0
"""A vehicle that was held, or released, is located when it hovers: a copter stops within this from its fastest."""

_HELD_SIGMA_M: Final = 1.0
"""How far off one may hover that was told to stop, from where that should have brought it."""

MOST_TRIMS: Final = 2

_FIXES: Final = 3
"""How often one is located of whom it is not known where it stands: each time by transmitters better chosen."""


@dataclass(frozen=True)
class Surroundings:
    """What the journeys of a relay have in common."""

    standing: Standing
    emission: EmissionControl
    frame: FormationFrame
    clock: Clock
    settings: RelaySettings
    problem: RelayProblem
    announce: Announce
    trace: Trace = untraced

    def enter(self, record: ReceiverRecord, state: ReceiverState, reason: str = "") -> None:
        """Change the state of a receiver as the table allows, and tell."""
        require_transition(record.name, record.state, state)
        record.state, record.reason = state, reason
        self.announce(record)


@dataclass(frozen=True)
class Journey:
    """One receiver's way. `objection` says why it must not move now, or None; it may raise HoldRequiredError.

    `again`: it was held before. `hovering` is what hovers in the air besides the standing transmitters, for one that
    flies alone by a route of its own; None: it flies as planned, beside others.
    """

    record: ReceiverRecord
    around: Surroundings
    lease: SetpointLease
    observations: Observations
    objection: Callable[[], str | None]
    again: bool
    hovering: Mapping[str, complex] | None

    async def fly(self) -> None:
        """Bring the receiver to its slot and let it stand there. HoldRequiredError when it must hold where it is."""
        record = self.record
        self.around.enter(record, ReceiverState.LOCATING)
        if self.again:
            record.legs.clear()
            await self.around.clock.sleep(COMING_TO_REST_S)
        fix = await self.whereabouts()
        record.route = self._route_from(fix.position)
        record.place, record.covariance = fix.position, fix.covariance
        record.strayed, record.off_plan = False, self.hovering is not None
        await self._verify(await self._legs(fix))

    async def whereabouts(self) -> Fix:
        """Locate the receiver before it flies; again where it turns out to be far from where it was looked for."""
        record, settings = self.record, self.around.settings
        prior, covariance = self._expected()
        if self.hovering is None:
            return await self._lookout.locate(record.route.transmitters, settings.locate_samples, prior, covariance)
        for _ in range(_FIXES):
            fix = await self._lookout.locate((), settings.locate_samples, prior, covariance)
            if abs(fix.position - prior) <= settings.start_tolerance_m:
                break
            prior, covariance = fix.position, None
        return fix

    @property
    def _lookout(self) -> Lookout:
        around = self.around
        return Lookout(
            self.record.name,
            around.standing,
            around.emission,
            self.observations,
            self.objection,
            around.clock,
            around.settings.give_up_s,
            around.problem.heading_referenced,
        )

    def _expected(self) -> tuple[complex, Reals | None]:
        """Return where the receiver should be, and the covariance of that, m^2; None: it may be anywhere."""
        record = self.record
        if record.place is None:
            start_sigma_m = max(self.around.problem.start_sigma_m, STANDING_SIGMA_M)
            place, covariance = record.route.start, _wider(np.zeros((2, 2)), start_sigma_m)
        else:
            place, covariance = record.place, _wider(record.covariance, _HELD_SIGMA_M)
        return place, None if record.strayed else covariance

    def _route_from(self, located: complex) -> Route:
        """Return the planned route from where it was located, without legs for one that is back in its slot.

        Flown alone it is another, along what stands now. HoldRequiredError when it stands where it cannot begin.
        """
        record, settings, places = self.record, self.around.settings, self.around.standing.places
        if self.again and abs(located - record.route.target) <= 0.5 * settings.placement_tolerance_m:
            return replace(record.route, start=located, legs=())
        try:
            if self.hovering is not None:
                return reroute(self.around.problem, record.route, located, places, self.hovering)
            self._require_near(located)
            return replan(record.route, located, places, settings.min_separation_m)
        except PlannerError as error:
            record.place, record.off_plan = located, True
            raise NoWayError(str(error)) from error

    def _require_near(self, located: complex) -> None:
        """Return when the receiver is about where it should be; HoldRequiredError when it is not."""
        record, allowed_m = self.record, self.around.settings.start_tolerance_m
        expected = record.route.start if record.place is None else record.place
        off_m = abs(located - expected)
        if off_m <= allowed_m:
            return
        if record.place is None:
            raise HoldRequiredError(
                f"it was located {off_m:.1f} m from its start (more than {allowed_m:g} m): "
                "check the site frame, and which UAV stands where"
            )
        record.place, record.off_plan = located, True
        raise HoldRequiredError(
            f"it was located {off_m:.1f} m from where it was held (more than {allowed_m:g} m): check its sensor; "
            "resumed, it flies from where it was located"
        )

    async def _legs(self, fix: Fix) -> StopMonitor | None:
        """Fly the legs of the route, each with a stop monitor of its own, and return the last one's."""
        around, record = self.around, self.record
        place, covariance, monitor = fix.position, fix.covariance, None
        for number, leg in enumerate(record.route.legs, start=1):
            around.enter(record, ReceiverState[f"LEG_{number}"])
            around.emission.need(record.name, {leg.guide, *leg.stop_reference})
            rule = SLOT if number == len(record.route.legs) else TURN
            transmitters, sigma_m = dict(around.standing.places), dict(around.standing.sigma_m)
            monitor = TracedMonitor(
                leg,
                transmitters,
                place,
                covariance,
                around.clock.now_s(),
                rule,
                sigma_m,
                heading_referenced=around.problem.heading_referenced,
                tell=partial(around.trace, record.name),
            )
            try:
                await self._leg_flight(monitor).fly()
            finally:
                record.place, record.covariance = monitor.standing_place()
            place, covariance = monitor.place()
        return monitor

    def _leg_flight(self, monitor: StopMonitor) -> LegFlight:
        return LegFlight(
            self.record,
            monitor,
            self.lease,
            self.observations,
            objection=self.objection,
            announce=self.around.announce,
            frame=self.around.frame,
            clock=self.around.clock,
            settings=self.around.settings,
        )

    async def _verify(self, monitor: StopMonitor | None) -> None:
        """Locate the receiver in its slot and let it stand there; HoldRequiredError when it is too far from it.

        What the last leg's monitor knows is not given up for what is heard now: both count. Where together they put the
        receiver off its slot by more than they may be wrong, a trim leg takes it back.
        """
        around, record, route = self.around, self.record, self.record.route
        for trims_left in reversed(range(MOST_TRIMS + 1)):
            around.enter(record, ReceiverState.VERIFYING)
            await around.clock.sleep(around.settings.settle_s)
            fix = await self._lookout.locate(
                route.transmitters,
                around.settings.verify_samples,
                route.target,
                _wider(record.covariance, around.settings.placement_tolerance_m),
                monitor,
            )
            place, covariance = (fix.position, fix.covariance) if monitor is None else monitor.standing_place()
            record.place, record.covariance = place, covariance
            off_m = abs(place - route.target)
            if monitor is None or not trims_left or not worth_trimming(place - route.target, covariance):
                break
            around.enter(record, ReceiverState.TRIMMING, f"bearings put it {off_m:.2f} m from {route.slot}")
            await self._leg_flight(monitor).fly()
        disbelieved, tolerance_m = monitor is not None and monitor.disbelieved, around.settings.placement_tolerance_m
        require_in_slot(route, fix, place, covariance, tolerance_m, disbelieved=disbelieved)
        record.off_plan = False
        around.standing.join(record.name, place, covariance)
        around.enter(record, ReceiverState.PLACED, f"bearings put it {off_m:.2f} m from {route.slot}")


def _wider(covariance: Reals | None, sigma_m: float) -> Reals | None:
    """Return the covariance of what may besides be off by `sigma_m` on each axis."""
    return None if covariance is None else covariance + np.eye(2) * sigma_m**2
