"""What a rounded reading says: the angle lies within its step, which is told once and not with every report."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.relay.rounding import unrounded


def by_numbers(surplus: float, variance: float, step: float) -> tuple[float, float]:
    """Return mean and variance of a normal distribution cut off at the step's edges, added up."""
    at = np.linspace(surplus - step / 2.0, surplus + step / 2.0, 20_001)
    weights = np.exp((surplus**2 - at**2) / (2.0 * variance))
    mean = float(np.average(at, weights=weights))
    return mean, float(np.average((at - mean) ** 2, weights=weights))


@pytest.mark.parametrize("step", [0.051, 0.2, 1.0, 3.0])
@pytest.mark.parametrize("surplus", [0.0, 0.4, -0.9, 2.5, -4.9])
def test_it_is_the_distribution_cut_off_at_the_edges(surplus: float, step: float) -> None:
    told = unrounded(surplus, 1.0, step)
    assert told is not None
    mean, variance = by_numbers(surplus, 1.0, step)
    assert told.mean == pytest.approx(mean, rel=1e-4, abs=1e-6)
    assert told.variance == pytest.approx(variance, rel=1e-3)
    assert told.surprise == pytest.approx(mean**2 + variance, rel=1e-3)


@given(st.floats(-6.0, 6.0), st.floats(1e-9, 10.0), st.floats(1e-6, 1.0))
def test_whatever_is_read_the_answer_lies_within_its_step_and_is_surer_than_before(
    sigmas: float, sigma: float, step: float
) -> None:
    off = math.copysign(step / 2.0 + abs(sigmas) * sigma, sigmas)
    told = unrounded(off, sigma**2, step)
    if told is not None:
        assert abs(told.mean - off) <= step / 2.0 * (1.0 + 1e-6)
        assert 0.0 <= told.variance <= sigma**2


def test_a_reading_that_expects_nothing_outside_its_step_says_nothing() -> None:
    assert unrounded(0.0, 0.25**2, 1.0) is None
    assert unrounded(0.2, 0.25**2, 1.0) is not None
    assert unrounded(0.0, 0.35**2, 1.0) is not None


@pytest.mark.parametrize(
    ("noise", "sure"), [(0.0, math.sqrt(1.0 / 12.0)), (0.5, math.sqrt((0.5**2 + 1.0 / 12.0) / 100))]
)
def test_many_equal_readings_say_no_more_than_one_unless_noise_spreads_them(noise: float, sure: float) -> None:
    """Without noise a hundred of them leave the whole step; noise of half a step makes them a mean of a hundred."""
    draws, sigmas, within = random.Random(5), [], []
    for _ in range(200):
        truth, mean, variance = draws.uniform(-3.0, 3.0), 0.0, 4.0
        for _ in range(100):
            reading = round(truth + draws.gauss(0.0, noise))
            total = variance + noise**2
            told = unrounded(reading - mean, total, 1.0)
            if told is not None:
                gain = variance / total
                mean += gain * told.mean
                variance -= gain**2 * (total - told.variance)
        sigmas.append(math.sqrt(variance))
        within.append((truth - mean) ** 2 / variance)
    assert np.mean(sigmas) == pytest.approx(sure, rel=0.1)
    assert 0.7 < np.mean(within) < 1.4
