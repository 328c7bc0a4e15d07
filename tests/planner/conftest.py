"""Problems, an independent check of a plan, and a Monte-Carlo relay, for the tests of the planning methods."""

from __future__ import annotations

import cmath
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from planner.angles import subtended_angle, wrap, wrap_all
from planner.formations import circle
from planner.plan import RelayPlan, Route, plan_to_json
from planner.relay import RelayProblem
from planner.relay_accuracy import relay_accuracy

EIGHT = [
    (75.58, 4.66), (64.99, 45.21), (40.36, 103.13), (112.35, 195.95), (125.84, 209.70), (97.02, 257.83),
    (84.11, 288.20), (70.59, 331.74),
]  # fmt: skip
TWENTY = [
    (63.22, 356.41), (63.40, 50.45), (106.70, 47.58), (76.07, 61.12), (91.13, 77.02), (81.75, 87.07), (55.46, 130.98),
    (142.39, 134.34), (89.99, 146.39), (81.91, 173.37), (142.84, 194.59), (149.85, 217.47), (91.18, 217.10),
    (138.36, 225.17), (139.80, 250.65), (136.23, 270.87), (100.84, 305.10), (147.51, 336.24), (75.07, 344.66),
    (103.08, 349.62),
]  # fmt: skip
"""Initial polar positions of the paper's tables 3 and 4: radius, polar angle in degrees."""

ProblemMaker = Callable[..., RelayProblem]


def _paper_problem(starts: list[tuple[float, float]], **options: Any) -> RelayProblem:
    receivers = {f"U{k}": cmath.rect(r, math.radians(deg)) for k, (r, deg) in enumerate(starts, start=1)}
    return RelayProblem({"L0": 0j, "L1": 100 + 0j}, receivers, circle(len(starts), 100.0), **options)


@pytest.fixture(scope="session")
def eight() -> ProblemMaker:
    return lambda **options: _paper_problem(EIGHT, **options)


@pytest.fixture(scope="session")
def twenty() -> ProblemMaker:
    return lambda **options: _paper_problem(TWENTY, **options)


@pytest.fixture(scope="session")
def ring() -> ProblemMaker:
    """Return a maker of n receivers at random in a ring about a circle of slots, ten units apart."""

    def make(count: int, seed: int, **options: Any) -> RelayProblem:
        radius_m = max(100.0, 5.0 * count)
        rng = np.random.default_rng(seed)
        apart = [0j, complex(radius_m)]
        while len(apart) < count + 2:
            point = cmath.rect(rng.uniform(0.4, 1.5) * radius_m, rng.uniform(0.0, math.tau))
            if min(abs(point - other) for other in apart) >= 10.0:
                apart.append(point)
        receivers = {f"U{k}": point for k, point in enumerate(apart[2:], start=1)}
        return RelayProblem({"L0": 0j, "L1": complex(radius_m)}, receivers, circle(count, radius_m), **options)

    return make


@pytest.fixture(scope="session")
def lattice() -> ProblemMaker:
    """Return a maker of a dense lattice: spacing 15, starts at random over 1.3 times its sides, ten units apart."""

    def make(columns: int, rows: int, seed: int, **options: Any) -> RelayProblem:
        spacing_m = 15.0
        slots = {f"O{k + 1}": spacing_m * complex(k % columns, k // columns) for k in range(columns * rows)}
        sides = spacing_m * complex(columns, rows)
        middle = spacing_m * complex(columns - 1, rows - 1) / 2.0
        transmitters = {"L0": spacing_m * (-2 - 2j), "L1": spacing_m * complex(columns + 1, -2)}
        rng = np.random.default_rng(seed)
        apart = list(transmitters.values())
        while len(apart) < len(slots) + 2:
            point = middle + 1.3 * complex(rng.uniform(-0.5, 0.5) * sides.real, rng.uniform(-0.5, 0.5) * sides.imag)
            if min(abs(point - other) for other in apart) >= 10.0:
                apart.append(point)
        receivers = {f"U{k}": point for k, point in enumerate(apart[2:], start=1)}
        return RelayProblem(transmitters, receivers, slots, **options)

    return make


def _path(route: Route) -> np.ndarray:
    """Points along a route, at most a quarter unit apart, with every corner."""
    pieces = [np.linspace(leg.start, leg.end, 2 + int(leg.length_m / 0.25)) for leg in route.legs] or [
        np.array([route.start])
    ]
    return np.concatenate(pieces)


def _check_legs(route: Route, at: dict[str, complex]) -> None:
    begin = route.start
    for leg in route.legs:
        guide = at[leg.guide]
        assert leg.start == begin
        assert leg.length_m > 0.0
        off_line = abs(wrap(2.0 * cmath.phase((leg.end - leg.start) / (leg.end - guide)))) / 2.0 * leg.length_m
        assert off_line < 1e-6, "a leg lies on the line of bearing of its guide"
        closing = abs(leg.end - guide) - abs(leg.start - guide)
        assert math.isclose(closing, -leg.length_m if leg.direction == "towards" else leg.length_m, abs_tol=1e-6)
        first, second = (at[name] for name in leg.stop_reference)
        assert first != second
        assert abs(wrap(leg.stop_angle_rad - float(subtended_angle(leg.end, first, second)))) < 1e-9
        begin = leg.end
    assert abs(begin - route.target) < 1e-6


def _check_plan(problem: RelayProblem, plan: RelayPlan) -> None:
    """Check everything a plan promises, from the routes alone."""
    json.dumps(plan_to_json(plan), allow_nan=False)
    assert len(plan.routes) == min(len(problem.receivers), len(problem.slots))
    assert len({route.receiver for route in plan.routes}) == len({route.slot for route in plan.routes})
    assert len({route.slot for route in plan.routes}) == len(plan.routes)
    at = dict(problem.transmitters) | {route.receiver: route.target for route in plan.routes}
    wave_of = dict.fromkeys(problem.transmitters, 0) | {route.receiver: route.wave for route in plan.routes}
    for route in plan.routes:
        assert route.start == problem.receivers[route.receiver]
        assert route.target == problem.slots[route.slot]
        _check_legs(route, at)
        assert all(wave_of[name] < route.wave for name in route.transmitters), "a transmitter stands before it is used"
        if problem.tolerance_3sigma_m is not None:
            assert route.predicted_3sigma_m is not None
            assert route.predicted_3sigma_m <= problem.tolerance_3sigma_m
    if problem.min_separation_m > 0.0:
        _check_separation(problem, plan)


def _check_separation(problem: RelayProblem, plan: RelayPlan) -> None:
    paths = {route.receiver: _path(route) for route in plan.routes}
    wave_of = {route.receiver: route.wave for route in plan.routes}
    in_the_air = [z for name, z in problem.transmitters.items() if name not in problem.ground_transmitters]
    for route in plan.routes:
        standing = in_the_air + list(problem.obstacles.values())
        standing += [other.target for other in plan.routes if other.wave < route.wave]
        standing += [z for name, z in problem.receivers.items() if wave_of.get(name, math.inf) > route.wave]
        moving = [paths[other.receiver] for other in plan.routes if other.wave == route.wave and other != route]
        others = np.concatenate([np.array(standing), *moving])
        path = paths[route.receiver]
        for begin in range(0, path.size, 200):
            nearest = np.abs(path[begin : begin + 200, None] - others[None, :]).min()
            assert nearest >= problem.min_separation_m - 1e-6


@pytest.fixture(scope="session")
def check_plan() -> Callable[[RelayProblem, RelayPlan], None]:
    return _check_plan


def _fly(problem: RelayProblem, plan: RelayPlan, runs: int, seed: int = 1) -> dict[str, np.ndarray]:
    """Return the error of every placement in `runs` relays flown with noise, without any linearisation.

    The bearing of the guide is held along a leg: towards or away from where the guide really stands, and
    north-referenced at the planned azimuth. The leg ends where the angle between the stop reference's true places
    is the stop angle, plus noise. A trim leg is flown exactly as estimated. Where that angle never comes the
    receiver is lost: its error is NaN, and it transmits from its slot, so that the others are judged all the same.
    """
    rng = np.random.default_rng(seed)
    sigma_rad = problem.bearing_sigma_rad / math.sqrt(problem.samples)
    planned = dict(problem.transmitters)
    real = {name: np.full(runs, place) for name, place in planned.items()}
    accuracy = relay_accuracy(problem, plan.routes)
    errors: dict[str, np.ndarray] = {}
    for route in plan.routes:
        place = route.start + problem.start_sigma_m * (rng.normal(size=runs) + 1j * rng.normal(size=runs))
        lost = np.zeros(runs, dtype=bool)
        for leg in route.legs:
            guide = real[leg.guide]
            if problem.heading_referenced:
                azimuth = np.angle(leg.end - planned[leg.guide]) + sigma_rad * rng.normal(size=runs)
                direction = np.exp(1j * azimuth)
            else:
                direction = (place - guide) / np.abs(place - guide)
            noise = sigma_rad * (rng.normal(size=runs) - rng.normal(size=runs))
            first, second = (real[name] for name in leg.stop_reference)
            distance = np.full(runs, abs(leg.end - planned[leg.guide]))
            for _ in range(40):
                place = guide + distance * direction
                surplus = wrap_all(subtended_angle(place, first, second) - leg.stop_angle_rad - noise)
                slope = np.imag(direction / (first - place)) - np.imag(direction / (second - place))
                distance = distance - np.clip(surplus / slope, -5.0, 5.0)
            place = guide + distance * direction
            surplus = wrap_all(subtended_angle(place, first, second) - leg.stop_angle_rad - noise)
            lost |= (np.abs(surplus) > 1e-6) | (distance <= 0.0)
        trim = accuracy[route.receiver].trim
        if trim is not None:
            surplus = np.stack([
                np.angle((real[name] - place) / (planned[name] - route.target)) for name in trim.transmitters
            ])  # fmt: skip
            surplus = surplus + sigma_rad * rng.normal(size=surplus.shape)
            if not problem.heading_referenced:
                surplus = surplus + rng.uniform(-1.0, 1.0, size=runs)
            x, y = trim.gain @ surplus
            place = place - (x + 1j * y)
        real[route.receiver] = np.where(lost, route.target, place)
        planned[route.receiver] = route.target
        errors[route.receiver] = np.where(lost, np.nan, place - route.target)
    return errors


def _worst_axis_3sigma_m(error: np.ndarray) -> float:
    arrived = error[~np.isnan(error)]
    assert arrived.size >= 0.98 * error.size, "at most one relay in fifty loses a receiver"
    return 3.0 * math.sqrt(np.linalg.eigvalsh(np.cov(arrived.real, arrived.imag))[-1])


@pytest.fixture(scope="session")
def flown_3sigma() -> Callable[..., np.ndarray]:
    """Return a function that gives the worst-axis 3 sigma of each route's placement over many relays, m."""

    def flown(problem: RelayProblem, plan: RelayPlan, runs: int = 2000) -> np.ndarray:
        errors = _fly(problem, plan, runs)
        return np.array([_worst_axis_3sigma_m(errors[route.receiver]) for route in plan.routes])

    return flown


@pytest.fixture(scope="session")
def prediction_ratios(flown_3sigma: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """Return a function that gives, for each route, the flown worst-axis 3 sigma over the predicted one."""

    def ratios(problem: RelayProblem, plan: RelayPlan, runs: int = 2000) -> np.ndarray:
        return flown_3sigma(problem, plan, runs) / np.array([route.predicted_3sigma_m for route in plan.routes])

    return ratios
