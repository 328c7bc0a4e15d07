"""The linear error model: against noise flown without linearisation, and in its limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.accuracy import BearingNoise, LegLine, PositionError, RelayErrors, bearing_gradient
from planner.landing import land
from planner.methods import joint, paper
from planner.relay import RelayProblem
from planner.relay_accuracy import relay_accuracy
from planner.sampled_route import sampled_error
from planner.stop_accuracy import best_stop
from planner.trimming import trim

HOME = BearingNoise(math.radians(0.5), 10, 1.0, heading_referenced=False)
COMPASS = replace(HOME, heading_referenced=True)
STATIONS = np.array([0j, 100 + 0j, 30 + 90j, -80 + 40j])
EXACT = np.arange(3)


def turn_problem(turn_deg, **options):
    """A receiver 60 units from its slot whose two guides, 100 units off, make it turn by this angle."""
    half = math.radians(turn_deg) / 2.0
    before, after = np.exp(1j * half), np.exp(-1j * half)
    transmitters = {"A": -100 * before, "B": 60 + 100 * after, "C": 30 + 100j, "D": 30 - 90j}
    return RelayProblem(
        {name: complex(place) for name, place in transmitters.items()}, {"U": 0j}, {"O": 60 + 0j}, **options
    )


@pytest.mark.parametrize("turn_deg", [2, 10, 30, 90])
@pytest.mark.parametrize("heading_referenced", [False, True])
def test_a_route_is_as_accurate_as_predicted(turn_deg, heading_referenced, prediction_ratios):
    problem = turn_problem(turn_deg, heading_referenced=heading_referenced)
    ratios = prediction_ratios(problem, joint.plan(problem), runs=4000)
    assert abs(ratios - 1.0).max() < 0.1


def test_a_near_straight_route_needs_stop_references_of_its_own():
    leg = LegLine(0, 40 + 10j, 60 + 15j)
    errors = RelayErrors(STATIONS, replace(HOME, start_sigma_m=0.0))
    good = best_stop(errors, errors.at_start(), leg, EXACT)
    poor = best_stop(errors, errors.at_start(), leg, np.array([0, 1]))
    assert good.error.worst_axis_3sigma_m < poor.error.worst_axis_3sigma_m


def test_the_error_grows_with_the_noise():
    leg = LegLine(0, 40 + 10j, 60 + 15j)
    sigmas = [
        best_stop(
            RelayErrors(STATIONS, replace(HOME, bearing_sigma_rad=sigma)),
            PositionError(np.eye(2), np.zeros((2, 4, 2))),
            leg,
            EXACT,
        )
        for sigma in (0.0, 0.01, 0.02)
    ]
    worst = [stop.error.worst_axis_3sigma_m for stop in sigmas]
    assert worst == sorted(worst)
    assert worst[0] < worst[2]


def test_without_noise_the_compass_makes_a_stop_exact():
    errors = RelayErrors(STATIONS, BearingNoise(0.0, 1, 5.0, heading_referenced=True))
    stop = best_stop(errors, errors.at_start(), LegLine(0, 40 + 10j, 60 + 15j), EXACT)
    assert stop.error.worst_axis_3sigma_m == pytest.approx(0.0, abs=1e-9)


def test_without_compass_the_start_error_stays_across_the_line():
    errors = RelayErrors(STATIONS, BearingNoise(0.0, 1, 1.0, heading_referenced=False))
    begin, end = 40 + 10j, 60 + 15j
    stop = best_stop(errors, errors.at_start(), LegLine(0, begin, end), EXACT)
    normal = 1j * (end - begin) / abs(end - begin)
    axis = np.array([normal.real, normal.imag])
    assert math.sqrt(axis @ stop.error.own @ axis) == pytest.approx(abs(end) / abs(begin), rel=1e-3)


def test_a_placed_receivers_error_reaches_those_it_guides():
    exact, placed = (RelayErrors(STATIONS, HOME) for _ in range(2))
    placed.place(2, PositionError(4.0 * np.eye(2), np.zeros((2, 4, 2))))
    leg = LegLine(2, 40 + 10j, 50 - 20j)
    stops = [best_stop(errors, errors.at_start(), leg, EXACT) for errors in (exact, placed)]
    assert stops[0].error.worst_axis_3sigma_m < stops[1].error.worst_axis_3sigma_m
    assert np.abs(stops[1].error.shared[:, 2]).max() > 0.1
    assert np.abs(stops[0].error.shared).max() == 0.0


def test_a_copy_is_independent():
    errors = RelayErrors(STATIONS, HOME)
    copied = errors.copy()
    copied.place(2, PositionError(np.eye(2), np.zeros((2, 4, 2))))
    leg = LegLine(2, 40 + 10j, 50 - 20j)
    before, after = (best_stop(one, one.at_start(), leg, EXACT) for one in (errors, copied))
    assert before.error.worst_axis_3sigma_m < after.error.worst_axis_3sigma_m


def test_no_pair_tells_the_end_of_a_leg_on_the_line_of_both():
    errors = RelayErrors(STATIONS, HOME)
    assert best_stop(errors, errors.at_start(), LegLine(0, 40 + 0j, 60 + 0j), np.array([0, 1])) is None


def test_a_guide_too_near_is_not_dependable():
    errors = RelayErrors(STATIONS, HOME)
    near, far = (
        best_stop(errors, errors.at_start(), LegLine(0, begin, 60 + 15j), EXACT) for begin in (4 + 1j, 40 + 10j)
    )
    assert not near.dependable
    assert far.dependable


@pytest.mark.parametrize("noise", [HOME, COMPASS])
def test_the_gradient_is_the_derivative_of_the_direction(noise):
    at, step = 12 + 7j, 1e-6
    for k, axis in enumerate((1.0, 1j)):
        turned = np.angle((STATIONS - at - step * axis) / (STATIONS - at + step * axis)) / (2 * step)
        assert bearing_gradient(at, STATIONS)[:, k] == pytest.approx(turned, abs=1e-8)


@pytest.mark.parametrize("noise", [HOME, COMPASS])
@pytest.mark.parametrize("count", [2, 3])
def test_the_trim_never_adds_error(noise, count):
    rng = np.random.default_rng(3)
    for _ in range(50):
        errors = RelayErrors(STATIONS, noise)
        root = rng.normal(size=(2, 2))
        errors.place(2, PositionError(root @ root.T, np.zeros((2, 4, 2))))
        stop = best_stop(errors, errors.at_start(), LegLine(0, 40 + 10j, 60 + 15j), EXACT)
        trimmed, _ = trim(errors, stop.error, 60 + 15j, np.arange(count))
        assert np.linalg.eigvalsh(stop.error.own - trimmed.own)[0] > -1e-9


@pytest.mark.parametrize("noise", [HOME, COMPASS])
def test_the_trim_does_what_it_predicts(noise):
    """Given a receiver with a correlated error, when it trims by measured bearings, then the rest is as predicted."""
    rng, runs, at = np.random.default_rng(5), 20_000, 60 + 15j
    errors = RelayErrors(STATIONS, noise)
    root = np.array([[1.0, 0.0, 0.0, 0.0], [0.3, 0.8, 0.0, 0.0], [0.5, 0.2, 1.2, 0.0], [0.0, 0.4, -0.3, 0.9]])
    joined = root @ root.T
    errors.place(2, PositionError(joined[:2, :2], np.zeros((2, 4, 2))))
    shared = np.zeros((2, 4, 2))
    shared[:, 2] = joined[2:, :2]
    error = PositionError(joined[2:, 2:], shared)
    trimmed, gain = trim(errors, error, at, EXACT)

    sources = rng.normal(size=(runs, 4)) @ root.T
    real = at + sources[:, 2] + 1j * sources[:, 3]
    places = np.tile(STATIONS[EXACT], (runs, 1))
    places[:, 2] += sources[:, 0] + 1j * sources[:, 1]
    noise_rad = rng.normal(size=(runs, 3)) * math.sqrt(noise.bearing_variance)
    surplus = np.angle((places - real[:, None]) / (STATIONS[EXACT] - at)) + noise_rad
    if not noise.heading_referenced:
        surplus += rng.uniform(-1.0, 1.0, size=(runs, 1))
    left = sources[:, 2:] - surplus @ gain.T
    assert np.cov(left.T) == pytest.approx(trimmed.own, rel=0.1, abs=0.02)


LIMITS = {
    "no limit": {},
    "home": {"tolerance_3sigma_m": 5.0},
    "compass": {"tolerance_3sigma_m": 2.5, "heading_referenced": True},
}


@pytest.fixture(scope="module", params=[(case, limits) for case in ("eight", "twenty") for limits in LIMITS], ids=str)
def relay(request, flown_3sigma):
    """A problem, its plan and the 3 sigma of each route's placement over 2,000 relays."""
    case, limits = request.param
    problem = request.getfixturevalue(case)(**LIMITS[limits])
    plan = joint.plan(problem)
    return problem, plan, flown_3sigma(problem, plan)


def test_every_receiver_of_a_relay_ends_as_accurately_as_predicted(relay):
    _, plan, flown_m = relay
    assert abs(flown_m / np.array([route.predicted_3sigma_m for route in plan.routes]) - 1.0).max() < 0.1


def test_the_trim_improves_every_receiver_of_a_relay_or_leaves_it(relay, flown_3sigma):
    problem, plan, untrimmed_m = relay
    trimmed = replace(problem, map_trim=True)
    accuracy = relay_accuracy(trimmed, plan.routes)
    predicted_m = np.array([accuracy[route.receiver].worst_axis_3sigma_m for route in plan.routes])
    assert (predicted_m <= np.array([route.predicted_3sigma_m for route in plan.routes]) + 1e-9).all()
    flown_m = flown_3sigma(trimmed, plan)
    assert abs(flown_m / predicted_m - 1.0).max() < 0.1
    sampling_error = 1.05
    assert (flown_m <= sampling_error * untrimmed_m).all()


LEGS = [LegLine(0, 40 + 10j, 52 + 13j), LegLine(2, 52 + 13j, 56 - 1j)]
REFERENCES = [(1, 3), (0, 2)]


@pytest.mark.parametrize("heading_referenced", [False, True])
def test_with_little_noise_the_samples_say_what_the_linear_model_says(heading_referenced):
    errors = RelayErrors(STATIONS, BearingNoise(1e-5, 10, 1e-3, heading_referenced))
    errors.place(2, PositionError(np.array([[4.0, 1.0], [1.0, 2.0]]) * 1e-6, np.zeros((2, 4, 2))))
    linear = errors.at_start()
    for leg, reference in zip(LEGS, REFERENCES, strict=True):
        linear = best_stop(errors, linear, leg, np.array(reference)).error
    sampled = sampled_error(errors, LEGS, REFERENCES)
    assert sampled.own == pytest.approx(linear.own, rel=1e-3)
    assert sampled.shared == pytest.approx(linear.shared, rel=1e-3, abs=1e-9)


def test_a_route_most_samples_lose_keeps_the_linear_prediction():
    errors = RelayErrors(STATIONS, replace(HOME, start_sigma_m=40.0))
    assert sampled_error(errors, LEGS, REFERENCES) is None
    landing = land(errors, LEGS, [np.array(reference) for reference in REFERENCES])
    assert not landing.dependable
    assert landing.error is landing.stops[-1].error


@pytest.mark.parametrize("heading_referenced", [False, True])
def test_the_accuracy_of_a_plan_is_what_the_plan_says(eight, heading_referenced):
    problem = eight(heading_referenced=heading_referenced)
    plan = joint.plan(problem)
    accuracy = relay_accuracy(problem, plan.routes)
    for route in plan.routes:
        assert accuracy[route.receiver].worst_axis_3sigma_m == pytest.approx(route.predicted_3sigma_m)
        assert len(accuracy[route.receiver].leg_ends) == len(route.legs)


@pytest.mark.parametrize("heading_referenced", [False, True])
def test_the_papers_chain_is_predicted_too(eight, heading_referenced, prediction_ratios):
    problem = eight(heading_referenced=heading_referenced)
    chain = paper.plan(problem)
    assert abs(prediction_ratios(problem, chain) - 1.0).max() < 0.1


def test_where_the_papers_chain_runs_out_of_proportion_nothing_is_predicted(ring):
    chain = paper.plan(ring(60, 0, min_separation_m=0.0))
    predicted_m = [route.predicted_3sigma_m for route in chain.routes]
    assert predicted_m[0] is not None
    assert predicted_m[-1] is None
    assert all(one is None or 0.0 < one < 300.0 for one in predicted_m)


def test_a_leg_of_no_length_leaves_the_error_as_it_was():
    problem = RelayProblem({"L0": 0j, "L1": 100 + 0j}, {"U": 130 + 40j}, {"O": 115 + 20j}, min_separation_m=0.0)
    route = paper.plan(problem).routes[0]
    assert min(leg.length_m for leg in route.legs) < 1e-9
    accuracy = relay_accuracy(problem, [route])["U"]
    assert len(accuracy.leg_ends) == 2
    assert accuracy.worst_axis_3sigma_m == pytest.approx(route.predicted_3sigma_m)


def test_whom_a_stop_reference_tells_nothing_is_left_out_with_all_that_follow(eight):
    plan = joint.plan(eight())
    route = plan.routes[0]
    blind = replace(route.legs[0], guide="L0", stop_reference=("L0", "L1"), start=40 + 0j, end=60 + 0j)
    accuracy = relay_accuracy(eight(), [replace(route, legs=(blind,)), *plan.routes[1:]])
    assert route.receiver not in accuracy
    dependent = [one.receiver for one in plan.routes if route.receiver in one.transmitters]
    assert dependent
    assert not accuracy.keys() & set(dependent)
