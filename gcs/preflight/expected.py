"""What a playbook and its plan say of each vehicle before it flies."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.mavlink.checks import Intent
from gcs.playbook.schema import Playbook
from planner.frames import SiteFrame
from planner.plan import RelayPlan


@dataclass(frozen=True)
class Expected:
    """What one vehicle should be, where it should stand, and what is going to be asked of it."""

    intent: Intent
    autopilot: str | None
    """The autopilot the playbook names; None where its heartbeat is to say it."""
    start: complex
    """Where it should stand: north + i east of the site's origin, m."""
    start_sigma_m: float
    min_separation_m: float
    site: SiteFrame


def expectations(playbook: Playbook, plan: RelayPlan) -> dict[str, Expected]:
    """Return what is expected of every UAV, by its name."""
    frame, site = playbook.site.frame, SiteFrame(playbook.site.origin)
    reach_m = {
        route.receiver: max((abs(leg.end - route.start) for leg in route.legs), default=0.0) for route in plan.routes
    }
    return {
        name: Expected(
            intent=Intent(
                altitude_m=playbook.flight.altitude_m,
                speed_mps=playbook.flight.speed_mps,
                reach_m=reach_m.get(name, 0.0),
                station_system_id=playbook.mavlink.system_id,
            ),
            autopilot=None if playbook.vehicles is None else playbook.vehicles[name].autopilot,
            start=frame.to_site(start),
            start_sigma_m=playbook.planner.start_sigma_m,
            min_separation_m=playbook.planner.min_separation_m,
            site=site,
        )
        for name, start in playbook.uavs.items()
    }
