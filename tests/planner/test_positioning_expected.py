"""Locating by subtended angles with a prior that counts: the maximum a posteriori of what was expected and seen."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from planner.errors import PositioningError
from planner.positioning import Fix, locate_by_subtended_angles

FIELD = {"L0": 0j, "L1": 100 + 0j, "L2": 30 + 90j, "L3": -60 - 70j, "L4": 110 + 85j}
RECEIVER = 45 + 30j
SIGMA_RAD = math.radians(0.5)
HARDLY = np.eye(2) * 1e6


def first(count: int) -> dict[str, complex]:
    return dict(list(FIELD.items())[:count])


def seen(transmitters: dict[str, complex], noise: np.random.Generator | None = None) -> dict[str, float]:
    """Directions from a nose that points anywhere."""
    off = np.zeros(len(transmitters)) if noise is None else noise.normal(0.0, SIGMA_RAD, len(transmitters))
    return {name: cmath.phase(at - RECEIVER) + 2.2 + off[k] for k, (name, at) in enumerate(transmitters.items())}


def located(count: int, prior: complex, covariance: np.ndarray | None) -> Fix:
    return locate_by_subtended_angles(seen(first(count)), FIELD, SIGMA_RAD, prior, covariance)


def test_two_transmitters_correct_what_was_expected_across_their_circle_only() -> None:
    fix = located(2, RECEIVER + 1.0 - 2.0j, np.eye(2))
    angle = cmath.phase((FIELD["L1"] - fix.position) / (FIELD["L0"] - fix.position))
    assert angle == pytest.approx(cmath.phase((FIELD["L1"] - RECEIVER) / (FIELD["L0"] - RECEIVER)), abs=2.0 * SIGMA_RAD)
    well, hardly = np.linalg.eigvalsh(fix.covariance)
    assert well < 0.5
    assert hardly == pytest.approx(1.0)  # along the circle nothing was learned


def test_a_prior_of_next_to_nothing_changes_nothing() -> None:
    with_it, without = located(4, 40 + 40j, HARDLY), located(4, 40 + 40j, None)
    assert with_it.position == pytest.approx(without.position, abs=1e-3)
    assert np.allclose(with_it.covariance, without.covariance, rtol=1e-3)


@pytest.mark.parametrize("count", [2, 3])
def test_the_covariance_is_that_of_the_error(count: int) -> None:
    """Start and bearings drawn 400 times: the squared distance in standard deviations is 2 on average, give or take."""
    noise = np.random.default_rng(5)
    covariance = np.array([[2.0, 0.8], [0.8, 1.0]])
    squares = []
    for east, north in noise.multivariate_normal([0.0, 0.0], covariance, 400):
        expected = RECEIVER + complex(east, north)
        fix = locate_by_subtended_angles(seen(first(count), noise), FIELD, SIGMA_RAD, expected, covariance)
        off = np.array([(fix.position - RECEIVER).real, (fix.position - RECEIVER).imag])
        squares.append(off @ np.linalg.solve(fix.covariance, off))
    assert np.mean(squares) == pytest.approx(2.0, rel=0.15)


def test_of_five_the_one_that_lies_is_found_and_of_four_it_is_a_contradiction() -> None:
    """What was expected is no witness against a direction: it may be wrong itself."""
    directions = seen(FIELD)
    directions["L1"] += math.radians(20.0)
    fix = locate_by_subtended_angles(directions, FIELD, SIGMA_RAD, RECEIVER + 0.5, np.eye(2))
    assert fix.rejected == ("L1",)
    assert abs(fix.position - RECEIVER) < 1.0
    del directions["L4"]
    with pytest.raises(PositioningError, match="expected"):
        locate_by_subtended_angles(directions, FIELD, SIGMA_RAD, RECEIVER + 0.5, np.eye(2))


@pytest.mark.parametrize("count", [3, 4, 5])
@pytest.mark.parametrize("off", [12, 12j, -12j, 20 + 20j, 30j, -40])
def test_who_is_far_from_where_it_was_expected_is_refused(count: int, off: complex) -> None:
    with pytest.raises(PositioningError, match="expected"):
        located(count, RECEIVER + off, np.eye(2))


@pytest.mark.parametrize("off", [12j, -12j, 20 + 20j, -40])
def test_two_transmitters_notice_who_is_off_their_circle(off: complex) -> None:
    with pytest.raises(PositioningError, match="expected"):
        located(2, RECEIVER + off, np.eye(2))


def test_one_transmitter_and_two_without_a_prior_are_too_few() -> None:
    with pytest.raises(PositioningError, match="two transmitters"):
        located(1, RECEIVER, np.eye(2))
    with pytest.raises(PositioningError, match="three transmitters"):
        located(2, RECEIVER, None)


@pytest.mark.parametrize("variance", [0.0, -1.0, math.inf, math.nan])
def test_a_covariance_that_is_none_is_refused(variance: float) -> None:
    with pytest.raises(PositioningError, match="covariance"):
        located(3, RECEIVER, np.diag([1.0, variance]))


def test_on_their_circle_three_need_what_was_expected() -> None:
    circle = {name: RECEIVER + 50.0 + cmath.rect(50.0, turn) for name, turn in (("A", 0.5), ("B", 2.0), ("C", -1.2))}
    directions = {name: cmath.phase(at - RECEIVER) for name, at in circle.items()}
    with pytest.raises(PositioningError):
        locate_by_subtended_angles(directions, circle, SIGMA_RAD, RECEIVER + 1.0)
    fix = locate_by_subtended_angles(directions, circle, SIGMA_RAD, RECEIVER + 1.0, np.eye(2))
    assert abs(fix.position - RECEIVER) < 1.5
