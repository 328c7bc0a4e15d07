"""A route re-planned from where the receiver was really located, just before it is flown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from planner.errors import PlannerError
from planner.plan import Route
from planner.routes import Verdict, make_leg, two_leg_routes


def replan(route: Route, located: complex, transmitters: Mapping[str, complex], min_separation_m: float) -> Route:
    """Return the route with the same guides and stop references, but starting at `located`.

    The turning point of a two-leg route moves with the start; a route of one leg just starts elsewhere. Points are in
    the formation frame, m; `transmitters` holds every transmitter the route names. Raises PlannerError when the route
    cannot be flown from there.
    """
    turning_points = [leg.end for leg in route.legs[:-1]]
    if len(route.legs) == 2:
        first, second = (transmitters[leg.guide] for leg in route.legs)
        moved = two_leg_routes(located, route.target, first, second, min_separation_m)
        if not bool(moved.feasible):
            raise PlannerError(
                f"{route.receiver} cannot fly to {route.slot} from where it was located, "
                f"({located.real:.1f}, {located.imag:.1f}) m: {Verdict(int(moved.verdict)).reason}"
            )
        turning_points = [complex(moved.turning_point)]
    ends = [*turning_points, route.target][: len(route.legs)]
    starts = [located, *turning_points][: len(route.legs)]
    legs = tuple(
        make_leg(
            start,
            end,
            (leg.guide, transmitters[leg.guide]),
            ((leg.stop_reference[0], transmitters[leg.stop_reference[0]]),
             (leg.stop_reference[1], transmitters[leg.stop_reference[1]])),
        )
        for leg, start, end in zip(route.legs, starts, ends, strict=True)
    )  # fmt: skip
    return replace(route, start=located, legs=legs)
