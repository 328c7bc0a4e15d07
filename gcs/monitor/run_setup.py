"""What a run is about, for screens: told once, from the playbook and the plan."""

from __future__ import annotations

from drivers.bus.run_messages import LegSetup, Place, RouteSetup, RunSetup, TransmitterSetup
from gcs.monitor.timing import Pace, planned_times_s
from gcs.playbook.schema import Playbook
from planner.plan import Leg, RelayPlan


def run_setup(
    playbook: Playbook,
    plan: RelayPlan,
    *,
    run: str,
    started_ns: int,
    number: int = 0,
    attended: bool = False,
    folder: str = "",
) -> RunSetup:
    """Return the setup of a run that flies this plan."""
    times_s = planned_times_s(plan.routes, Pace(playbook.flight.speed_mps))
    return RunSetup(
        run=run,
        playbook=playbook.name,
        started_ns=started_ns,
        latitude_deg=playbook.site.latitude_deg,
        longitude_deg=playbook.site.longitude_deg,
        altitude_m=playbook.site.altitude_m,
        axis_azimuth_rad=playbook.site.frame.axis_azimuth_rad,
        slots={name: place(at) for name, at in playbook.formation.points().items()},
        transmitters=[
            TransmitterSetup(name, place(transmitter.at), transmitter.beacon)
            for name, transmitter in playbook.transmitters.items()
        ],
        routes=[
            RouteSetup(
                receiver=route.receiver,
                slot=route.slot,
                wave=route.wave,
                model=route.model,
                start_m=place(route.start),
                slot_m=place(route.target),
                legs=[_leg(leg) for leg in route.legs],
                begins_s=times_s[route.receiver][0],
                ends_s=times_s[route.receiver][1],
            )
            for route in plan.routes
        ],
        fence=[place(corner) for corner in playbook.planner.fence],
        min_separation_m=playbook.planner.min_separation_m,
        speed_mps=playbook.flight.speed_mps,
        flight_altitude_m=playbook.flight.altitude_m,
        predicted_s=max((ends_s for _, ends_s in times_s.values()), default=0.0),
        number=number,
        attended=attended,
        folder=folder,
    )


def place(point: complex) -> Place:
    """Return a point as messages have it."""
    return float(point.real), float(point.imag)


def _leg(leg: Leg) -> LegSetup:
    return LegSetup(
        leg.guide, leg.direction, leg.stop_reference, float(leg.stop_angle_rad), place(leg.start), place(leg.end)
    )
