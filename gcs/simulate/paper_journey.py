"""A journey as in the paper: located, two legs with raw stops, and then taken to stand in its slot."""

from __future__ import annotations

import numpy as np

from gcs.errors import HoldRequiredError
from gcs.relay.journey import COMING_TO_REST_S, Journey
from gcs.relay.records import LegRecord
from gcs.relay.states import ReceiverState
from gcs.simulate.paper_stop import RawStop
from planner.errors import PlannerError
from planner.plan import Leg
from planner.replan import replan


async def fly_as_the_paper(journey: Journey) -> None:
    """Bring a receiver to where the paper takes it to be in its slot. HoldRequiredError when it must hold."""
    around, record = journey.around, journey.record
    around.enter(record, ReceiverState.LOCATING)
    fix = await journey.whereabouts()
    record.place, record.covariance = fix.position, fix.covariance
    try:
        record.route = replan(record.route, fix.position, around.standing.places, around.settings.min_separation_m)
    except PlannerError as error:
        raise HoldRequiredError(str(error)) from error
    for number, leg in enumerate(record.route.legs, start=1):
        around.enter(record, ReceiverState[f"LEG_{number}"])
        around.emission.need(record.name, {leg.guide, *leg.stop_reference})
        flown = LegRecord(leg, started_s=around.clock.now_s())
        record.legs.append(flown)
        await _fly(journey, leg)
        flown.ended_s = around.clock.now_s()
    around.enter(record, ReceiverState.VERIFYING)
    await around.clock.sleep(COMING_TO_REST_S)
    slot = record.route.target
    record.place, record.covariance = slot, np.zeros((2, 2))
    around.standing.join(record.name, slot, record.covariance)
    around.enter(record, ReceiverState.PLACED, f"taken to stand in {record.route.slot}")


async def _fly(journey: Journey, leg: Leg) -> None:
    """Fly one leg at constant speed until a sample stops it. HoldRequiredError when it must hold."""
    around, lease = journey.around, journey.lease
    clock, settings, stop = around.clock, around.settings, RawStop(leg, dict(around.standing.places))
    started_s = usable_s = clock.now_s()
    try:
        while clock.now_s() <= started_s + settings.longest_leg_s(leg):
            observation = await journey.observations.next(settings.gap_s)
            problem = journey.objection()
            if problem is None and observation is not None and stop.usable(observation.directions_rad):
                usable_s = clock.now_s()
                if stop.reached(observation.directions_rad, observation.sigma_rad):
                    return
                from_north = observation.reference == "true_north"
                guide_rad = observation.directions_rad[leg.guide] if from_north else None
                velocity = stop.velocity(guide_rad, settings.limits.speed_mps)
                lease.renew(around.frame.to_site(velocity))
            elif problem is not None or clock.now_s() - usable_s >= settings.gap_s:
                lease.stop()
                if clock.now_s() - usable_s >= settings.give_up_s:
                    raise HoldRequiredError(problem or f"no bearings for its leg for {settings.give_up_s:g} s")
        raise HoldRequiredError(f"its stop angle did not come within {settings.longest_leg_s(leg):.0f} s")
    finally:
        lease.stop()
