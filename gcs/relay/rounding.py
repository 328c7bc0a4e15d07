"""What a rounded reading says of what was rounded: that it lies within the reading's step, and no more.

A sensor that shows whole degrees far from a transmitter shows one number for seconds. Its rounding error is then no
noise: it stays, and however many readings are alike, they say no more than one. As the direction turns, the number
changes, and that says much: it is at the edge of a step now.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

_EVEN_SIGMAS: Final = 1.6
"""What is spread evenly reaches 1.7 standard deviations to either side: a bit less, or what one reading leaves would be
cut off again by the next one like it, and the next."""
_NARROW: Final = 0.05
"""A step of less than this share of a standard deviation is all but even: then rounding is noise like any other."""


@dataclass(frozen=True)
class Unrounded:
    """What was rounded, less what was expected: mean and variance, and how much of a surprise that is.

    The surprise is the mean square in variances of what was expected: 1 on average, when that is right.
    """

    mean: float
    variance: float
    surprise: float


def unrounded(surplus: float, variance: float, step: float) -> Unrounded | None:
    """Return what a reading says that is `surplus` from what was expected with a variance; None: nothing new.

    It was rounded to the nearest `step`, after its noise, which is part of the variance. All in one unit; a normal
    distribution cut off at the step's edges, by its first two moments. What was expected may be what former readings
    of the same step left: where, spread evenly, it lies within the step, no reading cuts off anything any more. Not for
    a step that is more than thirty standard deviations off.
    """
    sigma, half = math.sqrt(variance), step / 2.0
    if abs(surplus) + _EVEN_SIGMAS * sigma <= half:
        return None
    if step < _NARROW * sigma:
        return Unrounded(surplus, step**2 / 12.0, surplus**2 / variance)
    low, high = (surplus - half) / sigma, (surplus + half) / sigma
    share = _share(low, high)
    shift = (_density(low) - _density(high)) / share
    square = 1.0 + (low * _density(low) - high * _density(high)) / share
    return Unrounded(shift * sigma, max(square - shift**2, 0.0) * variance, square)


def _density(sigmas: float) -> float:
    return math.exp(-(sigmas**2) / 2.0) / math.sqrt(math.tau)


def _share(low: float, high: float) -> float:
    """Return the share of a normal distribution between two bounds, as exact in its tails as in its middle."""
    if low < 0.0 < high:
        return (math.erf(high / math.sqrt(2.0)) - math.erf(low / math.sqrt(2.0))) / 2.0
    near, far = sorted((abs(low), abs(high)))
    return (math.erfc(near / math.sqrt(2.0)) - math.erfc(far / math.sqrt(2.0))) / 2.0
