"""Two-leg routes: the general one, and the paper's route models I and II with every intermediate.

A route starts at D and ends at the slot O. Leg 1 runs on the line through D and the first guide up to the turning
point F, leg 2 on the line through O and the second guide. Model I takes A first and B second, model II B first and A
second. All points are complex, formation frame, metres; every angle is signed, counter-clockwise.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.angles import direction, subtended_angle, wrap
from planner.errors import PlannerError
from planner.plan import Direction, Leg

SEPARATION_TOLERANCE_M = 1e-9
"""A path exactly at the separation distance is accepted."""

_PARALLEL_SINE = 1e-12
_LONGEST_LEG_RATIO = 10.0
"""A leg longer than this many times the figure D, O, guides comes from nearly parallel lines."""
_COINCIDENT_RATIO = 1e-9

Points = NDArray[np.complex128]


class Verdict(IntEnum):
    """Whether a route can be flown, or the first reason why not."""

    FEASIBLE = 0
    AT_TRANSMITTER = 1
    PARALLEL = 2
    TOO_CLOSE = 3

    @property
    def reason(self) -> str:
        """The verdict in words."""
        return _REASONS[self]


_REASONS = {
    Verdict.FEASIBLE: "feasible",
    Verdict.AT_TRANSMITTER: "its start, turning point or end falls on a transmitter, where no angle is defined",
    Verdict.PARALLEL: "the two lines of bearing are parallel or nearly so",
    Verdict.TOO_CLOSE: "a leg passes through, or within the separation of, a transmitter",
}


@dataclass(frozen=True)
class TwoLegRoutes:
    """Many routes at once; the arrays share one shape.

    Where `verdict` is not FEASIBLE, `length_m` is 0 and `turning_point` is the start: finite, and not to be used.
    """

    turning_point: Points
    length_m: NDArray[np.float64]
    verdict: NDArray[np.int8]

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Where the route can be flown."""
        return np.asarray(self.verdict == Verdict.FEASIBLE)


def two_leg_routes(
    start: ArrayLike,
    target: ArrayLike,
    first_guide: ArrayLike,
    second_guide: ArrayLike,
    min_separation_m: float = 0.0,
) -> TwoLegRoutes:
    """Return the two-leg routes start -> F -> target, F on both lines of bearing.

    Points broadcast against each other. A route is infeasible where its lines are parallel or nearly so, where an end
    of a leg falls on a guide, or (`min_separation_m` > 0) where a leg passes closer than that to a guide.
    """
    d, o, a, b = np.broadcast_arrays(
        *(np.asarray(p, dtype=np.complex128) for p in (start, target, first_guide, second_guide))
    )
    to_start, to_target = d - a, o - b
    scale = np.abs(to_start) + np.abs(to_target) + np.abs(o - d)
    cross = np.imag(np.conj(to_start) * to_target)
    parallel = np.abs(cross) <= _PARALLEL_SINE * np.abs(to_start) * np.abs(to_target)
    along = np.imag(np.conj(b - a) * to_target) / np.where(parallel, 1.0, cross)
    turning = np.where(parallel, d, a + along * to_start)
    first_m, second_m = np.abs(turning - d), np.abs(o - turning)

    verdict = np.zeros(d.shape, dtype=np.int8)
    if min_separation_m > 0.0:
        clearance_m = np.minimum.reduce(
            [distance_to_segment(p, q, guide) for p, q in ((d, turning), (turning, o)) for guide in (a, b)]
        )
        verdict[clearance_m < min_separation_m - SEPARATION_TOLERANCE_M] = Verdict.TOO_CLOSE
    verdict[parallel | (np.maximum(first_m, second_m) > _LONGEST_LEG_RATIO * scale)] = Verdict.PARALLEL
    for point in (d, turning, o):
        for guide in (a, b):
            verdict[np.abs(point - guide) <= _COINCIDENT_RATIO * scale] = Verdict.AT_TRANSMITTER
    feasible = verdict == Verdict.FEASIBLE
    return TwoLegRoutes(np.where(feasible, turning, d), np.where(feasible, first_m + second_m, 0.0), verdict)


def general_routes(
    start: ArrayLike,
    target: ArrayLike,
    first_guide: ArrayLike,
    second_guide: ArrayLike,
    min_separation_m: float = 0.0,
) -> TwoLegRoutes:
    """Return `two_leg_routes` of which no leg passes through its own guide, whatever the separation.

    Points broadcast: starts (n, 1, 1, 1), targets (m, 1, 1), first guides (t, 1) and second guides (t) give the routes
    of every receiver to every slot by every ordered pair of transmitters. A route along a single line of bearing
    (guide on the line start-target) has one leg of length 0.
    """
    routes = two_leg_routes(start, target, first_guide, second_guide, min_separation_m)
    d, o, a, b = (np.asarray(p, dtype=np.complex128) for p in (start, target, first_guide, second_guide))
    turning = routes.turning_point
    through = (np.real(np.conj(d - a) * (turning - a)) < 0.0) | (np.real(np.conj(o - b) * (turning - b)) < 0.0)
    verdict = np.where(through & routes.feasible, np.int8(Verdict.TOO_CLOSE), routes.verdict)
    feasible = verdict == Verdict.FEASIBLE
    return TwoLegRoutes(np.where(feasible, turning, d), np.where(feasible, routes.length_m, 0.0), verdict)


def half_angle_tangents(
    start: ArrayLike, target: ArrayLike, guide: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return p = tan(a/2) of every guide for leg 1 and q = tan(b/2) for leg 2; arguments broadcast.

    a and b are the angles at the start and at the target of the triangle start, F, target on the left of the way from
    start to target; a route by guides A and B is (1 + x) / (1 - x) times as long as the straight line, x the smaller of
    p_A q_B (turning left of it) and its inverse (turning right). So the best pair is (min p)(min q) or (max p)(max q).
    Kept within 1e-12 .. 1e12; for a target equal to the start every tangent is 1e-12.
    """
    d, o, g = (np.asarray(z, dtype=np.complex128) for z in (start, target, guide))
    direct = o - d
    p = np.tan(np.mod(np.angle((g - d) * np.conj(direct)), np.pi) / 2)
    q = np.tan((np.pi - np.mod(np.angle((g - o) * np.conj(direct)), np.pi)) / 2)
    least, most = 1e-12, 1e12
    return np.clip(p, least, most), np.where(direct == 0.0, least, np.clip(q, least, most))


def distance_to_segment(begin: ArrayLike, end: ArrayLike, point: ArrayLike) -> NDArray[np.float64]:
    """Return the distance from `point` to the segment begin-end, m; arguments broadcast, a segment may be a point."""
    p, q, x = (np.asarray(z, dtype=np.complex128) for z in (begin, end, point))
    vector = q - p
    square = np.abs(vector) ** 2
    along = np.real(np.conj(vector) * (x - p)) / np.where(square > 0.0, square, 1.0)
    return np.asarray(np.abs(p + np.clip(along, 0.0, 1.0) * vector - x))


def leg_direction(guide: complex, begin: complex, end: complex) -> Direction:
    """Return whether a leg on the line of bearing of `guide` flies towards it or away from it."""
    return "towards" if ((end - begin) * (guide - begin).conjugate()).real > 0.0 else "away"


def make_leg(
    begin: complex, end: complex, guide: tuple[str, complex], reference: tuple[tuple[str, complex], tuple[str, complex]]
) -> Leg:
    """Return the leg along `guide`'s line of bearing that stops at the angle the reference subtends at `end`."""
    (first, first_at), (second, second_at) = reference
    return Leg(
        guide=guide[0],
        direction=leg_direction(guide[1], begin, end),
        stop_reference=(first, second),
        stop_angle_rad=float(subtended_angle(end, first_at, second_at)),
        start=begin,
        end=end,
    )


@dataclass(frozen=True)
class TwoStepRoute:
    """The paper's route for one receiver, about A with polar axis A-B, with every intermediate (eqs. 12 to 23, signed).

    `s_1_m` and `s_2_m` are positive away from the leg's guide. `alpha_1_rad` is alpha_1 of model I or alpha_1' of
    model II, `rho_f_m` the signed polar radius of the turning point on the ray at `theta_0` (II) or
    `theta_0 + theta_prime` (I).
    """

    model: Literal["I", "II"]
    theta_prime_rad: float
    alpha_1_rad: float
    alpha_2_rad: float
    rho_f_m: float
    s_1_m: float
    s_2_m: float
    turning_point: complex

    @property
    def length_m(self) -> float:
        """R of eq. 24, m."""
        return abs(self.s_1_m) + abs(self.s_2_m)


def model_1(start: complex, target: complex, a: complex, b: complex) -> TwoStepRoute:
    """Return route model I: first along A-D, then along B-O (eqs. 12 to 17). Raises PlannerError on parallel lines."""
    theta_prime, alpha_2 = _theta_prime_and_alpha_2(start, target, a, b)
    alpha_1 = wrap(alpha_2 - theta_prime)
    if abs(math.sin(alpha_1)) <= _PARALLEL_SINE:
        raise PlannerError(f"route model I from {start} to {target}: {Verdict.PARALLEL.reason}")
    rho_f = math.sin(alpha_1 + theta_prime) / math.sin(alpha_1) * abs(target - a)
    turning = a + cmath.rect(rho_f, direction(start - a))
    return TwoStepRoute(
        "I", theta_prime, alpha_1, alpha_2, rho_f, _signed(a, start, turning), _signed(b, turning, target), turning
    )


def model_2(start: complex, target: complex, a: complex, b: complex) -> TwoStepRoute:
    """Return route model II: first along B-D, then along A-O (eqs. 18 to 23). Raises PlannerError on parallel lines."""
    theta_prime, alpha_2 = _theta_prime_and_alpha_2(start, target, a, b)
    alpha_0 = float(subtended_angle(start, a, b))
    alpha_1 = wrap(alpha_0 + theta_prime)
    if abs(math.sin(alpha_1)) <= _PARALLEL_SINE:
        raise PlannerError(f"route model II from {start} to {target}: {Verdict.PARALLEL.reason}")
    theta_0 = wrap(direction(target - a) - direction(b - a))
    rho_f = math.sin(alpha_1 + theta_0) / math.sin(alpha_1) * abs(b - a)
    turning = a + cmath.rect(rho_f, direction(target - a))
    return TwoStepRoute(
        "II", theta_prime, alpha_1, alpha_2, rho_f, _signed(b, start, turning), _signed(a, turning, target), turning
    )


def two_step(start: complex, target: complex, a: complex, b: complex) -> TwoStepRoute:
    """Return the shorter of route models I and II (eq. 24); PlannerError when both have parallel lines."""
    routes: list[TwoStepRoute] = []
    failure: PlannerError | None = None
    for model in (model_1, model_2):
        try:
            routes.append(model(start, target, a, b))
        except PlannerError as error:
            failure = error
    if not routes and failure is not None:
        raise failure
    return min(routes, key=lambda route: route.length_m)


def _theta_prime_and_alpha_2(start: complex, target: complex, a: complex, b: complex) -> tuple[float, float]:
    theta_prime = wrap(direction(start - a) - direction(target - a))
    return theta_prime, float(subtended_angle(target, a, b))


def _signed(guide: complex, begin: complex, end: complex) -> float:
    """Length of a leg, positive away from its guide (delta_1 and delta_2 of the paper)."""
    return math.copysign(abs(end - begin), abs(end - guide) - abs(begin - guide))
