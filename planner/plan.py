"""RelayPlan, Route, Leg: what planning yields, as frozen values, and their JSON form (plan.json)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

Direction = Literal["towards", "away"]


@dataclass(frozen=True)
class Leg:
    """One straight segment, flown along the line of bearing of `guide` until the stop condition.

    The stop condition: the subtended angle of `stop_reference` (from its first to its second transmitter,
    counter-clockwise, rad) reaches `stop_angle_rad`. Points are in the formation frame, m.
    """

    guide: str
    direction: Direction
    stop_reference: tuple[str, str]
    stop_angle_rad: float
    start: complex
    end: complex

    @property
    def length_m(self) -> float:
        """Planned length, m."""
        return abs(self.end - self.start)


@dataclass(frozen=True)
class Route:
    """How one receiver gets to its slot: the legs in the order they are flown."""

    receiver: str
    slot: str
    order: int
    wave: int
    model: str
    start: complex
    target: complex
    legs: tuple[Leg, ...]
    predicted_3sigma_m: float | None = None

    @property
    def length_m(self) -> float:
        """Planned length of all legs, m."""
        return sum(leg.length_m for leg in self.legs)

    @property
    def transmitters(self) -> tuple[str, ...]:
        """Every transmitter that must be on the air while this route is flown: guides and stop references."""
        return tuple(dict.fromkeys(name for leg in self.legs for name in (leg.guide, *leg.stop_reference)))


@dataclass(frozen=True)
class RelayPlan:
    """Assignment, order (waves) and a route for each receiver, in the order they are flown."""

    method: str
    routes: tuple[Route, ...]
    straight_line_bound_m: float
    makespan_s: float
    emission_transmitter_s: float

    @property
    def total_length_m(self) -> float:
        """Planned length of all routes, m."""
        return sum(route.length_m for route in self.routes)

    def route_of(self, receiver: str) -> Route:
        """Return the route of one receiver; KeyError when it has none."""
        for route in self.routes:
            if route.receiver == receiver:
                return route
        raise KeyError(receiver)


def plan_to_json(plan: RelayPlan) -> dict[str, Any]:
    """Return the plan as the documented plan.json object: metres, degrees, formation frame."""
    return {
        "method": plan.method,
        "total_length_m": plan.total_length_m,
        "straight_line_bound_m": plan.straight_line_bound_m,
        "makespan_s": plan.makespan_s,
        "emission_transmitter_s": plan.emission_transmitter_s,
        "receivers": [_route_to_json(route) for route in plan.routes],
    }


def plan_from_json(data: Mapping[str, Any]) -> RelayPlan:
    """Return the plan a plan.json object describes; KeyError, TypeError or ValueError when it is not one."""
    return RelayPlan(
        method=_text(data["method"]),
        routes=tuple(_route_from_json(route) for route in data["receivers"]),
        straight_line_bound_m=data["straight_line_bound_m"],
        makespan_s=data["makespan_s"],
        emission_transmitter_s=data["emission_transmitter_s"],
    )


def _route_to_json(route: Route) -> dict[str, Any]:
    return {
        "name": route.receiver,
        "slot": route.slot,
        "order": route.order,
        "wave": route.wave,
        "route_model": route.model,
        "start_m": _point_to_json(route.start),
        "slot_m": _point_to_json(route.target),
        "predicted_3sigma_m": route.predicted_3sigma_m,
        "legs": [
            {
                "guide": leg.guide,
                "direction": leg.direction,
                "stop_reference": list(leg.stop_reference),
                "stop_angle_deg": math.degrees(leg.stop_angle_rad),
                "length_m": leg.length_m,
                "end_m": _point_to_json(leg.end),
            }
            for leg in route.legs
        ],
    }


def _route_from_json(data: Mapping[str, Any]) -> Route:
    start = complex(*data["start_m"])
    legs: list[Leg] = []
    for leg in data["legs"]:
        legs.append(
            Leg(
                guide=_text(leg["guide"]),
                direction=leg["direction"],
                stop_reference=(_text(leg["stop_reference"][0]), _text(leg["stop_reference"][1])),
                stop_angle_rad=math.radians(leg["stop_angle_deg"]),
                start=legs[-1].end if legs else start,
                end=complex(*leg["end_m"]),
            )
        )
    return Route(
        receiver=_text(data["name"]),
        slot=_text(data["slot"]),
        order=data["order"],
        wave=data["wave"],
        model=data["route_model"],
        start=start,
        target=complex(*data["slot_m"]),
        legs=tuple(legs),
        predicted_3sigma_m=data["predicted_3sigma_m"],
    )


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r:.40} is no name")
    return value


def _point_to_json(point: complex) -> list[float]:
    return [point.real, point.imag]
