"""Whether a receiver stands where an earlier service left it: located from bearings before anybody counts on it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.errors import HoldRequiredError
from gcs.relay.journey import COMING_TO_REST_S, Journey
from gcs.relay.records import ReceiverRecord
from gcs.relay.standing import sigma_towards_m, worst_sigma_m
from gcs.relay.states import ReceiverState
from planner.positioning import Fix

_AGREEING_SIGMAS: Final = 3.0


async def verify(journey: Journey) -> None:
    """Let a PLACED receiver stand that is found in its slot; of a HELD one, note where it is. Nobody is moved.

    HoldRequiredError when it is not found, or a PLACED one somewhere else.
    """
    if journey.record.state is ReceiverState.HELD:
        await _find(journey)
    else:
        await _find_standing(journey)


async def _find(journey: Journey) -> None:
    """Locate a receiver that was on its way, once it has come to rest."""
    record, around = journey.record, journey.around
    around.enter(record, ReceiverState.LOCATING)
    journey.lease.stop()
    await around.clock.sleep(COMING_TO_REST_S)
    fix = await journey.whereabouts()
    record.place, record.covariance, record.strayed = fix.position, fix.covariance, False
    around.enter(record, ReceiverState.HELD, "located: it goes on in its turn")


async def _find_standing(journey: Journey) -> None:
    record, around = journey.record, journey.around
    fix = await journey.whereabouts()
    if around.problem.heading_referenced:
        fix = _with_what_was_known(fix, record)
    record.place, record.covariance = fix.position, fix.covariance
    off, slot = fix.position - record.route.target, record.route.slot
    allowed_m = around.settings.placement_tolerance_m + 3.0 * sigma_towards_m(off, fix.covariance)
    if abs(off) > allowed_m:
        record.off_plan = True
        raise HoldRequiredError(
            f"it was PLACED, and bearings put it {abs(off):.1f} m from {slot} (allowed are {allowed_m:.1f} m): "
            "check its sensor; resumed, it flies from where it was located"
        )
    record.reason = f"verified: bearings put it {abs(off):.2f} m from {slot}"
    around.standing.join(record.name, fix.position, fix.covariance)
    around.announce(record)


def _with_what_was_known(fix: Fix, record: ReceiverRecord) -> Fix:
    """Return a fix improved by where the receiver was left, unless the two do not agree: then it has moved."""
    if record.place is None or record.covariance is None:
        return fix
    apart = fix.position - record.place
    if abs(apart) > _AGREEING_SIGMAS * np.hypot(worst_sigma_m(fix.covariance), worst_sigma_m(record.covariance)):
        return fix
    known: NDArray[np.float64] = record.covariance
    weight = known @ np.linalg.inv(known + fix.covariance)
    place = record.place + complex(*(weight @ [apart.real, apart.imag]))
    return replace(fix, position=place, covariance=(np.eye(2) - weight) @ known)
