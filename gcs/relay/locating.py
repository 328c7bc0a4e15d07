"""Locating a hovering receiver: which transmitters it should hear, and what many reports of them say together."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.bearings import Observation, Observations
from planner.angles import wrap, wrap_all
from planner.errors import PositioningError
from planner.positioning import Fix, dilution, locate_by_bearings, locate_by_subtended_angles

WANTED_DILUTION_M_PER_RAD: Final = 400.0
"""Above this a fix is blurred (7 m per degree): one more transmitter is switched on."""

_MAD_TO_SIGMA: Final = 1.4826
_OUTLIER_SIGMAS: Final = 4.0
_SWAYS_M: Final = (0.1, 0.3, 1.0)
"""How far what stands in the air may sway: in calm air, and where directions contradict each other without wind."""
_MOST_REPORTS: Final = 4
"""So many reports are waited for, for each sample."""
_LEAST_SPREAD_RAD: Final = math.radians(0.01)
_OF_A_STEP: Final = 1.0 / math.sqrt(12.0)
"""The standard deviation of what is rounded to steps of 1: while a receiver hovers it may be one error all the time."""


def transmitters_to_hear(
    place: complex, needed: Collection[str], standing: Mapping[str, complex], *, heading_referenced: bool = True
) -> frozenset[str]:
    """Return the transmitters to locate a receiver by that is near `place`, m.

    Those its route needs anyway; where they fix the place badly, also those of the standing ones that sharpen it most,
    until two are heard and the dilution is as wanted or nothing helps any more.
    """

    def blurred(names: Collection[str]) -> float:
        """Return the GDOP of transmitters, m/rad; infinite for fewer than two."""
        heard_at = [standing[name] for name in sorted(names)]
        return float(dilution(place, heard_at, heading_referenced)) if len(heard_at) > 1 else math.inf

    heard = set(needed)
    others = set(standing) - heard
    while others:
        blur = blurred(heard)
        if len(heard) >= 2 and blur <= WANTED_DILUTION_M_PER_RAD:
            break
        best = min(sorted(others), key=lambda name: blurred(heard | {name}))
        if len(heard) >= 2 and blurred(heard | {best}) > 0.9 * blur:
            break
        heard.add(best)
        others.discard(best)
    return frozenset(heard)


async def hear(observations: Observations, names: Collection[str], count: int, gap_s: float) -> list[Observation]:
    """Return the next observations, until each transmitter named was heard `count` times.

    Gives up when no report comes for `gap_s`, or when most reports lack a transmitter.
    """
    heard: list[Observation] = []
    while len(heard) < _MOST_REPORTS * count and too_few(heard, names, count):
        observation = await observations.next(gap_s)
        if observation is None:
            break
        heard.append(observation)
    return heard


def too_few(observations: Sequence[Observation], names: Collection[str], count: int) -> dict[str, int]:
    """Return how often each of those was heard that were heard less than `count` times."""
    times = {name: sum(name in observation.directions_rad for observation in observations) for name in sorted(names)}
    return {name: heard for name, heard in times.items() if heard < count}


def locate(
    observations: Sequence[Observation],
    transmitters: Mapping[str, complex],
    place_sigma_m: Mapping[str, float],
    prior: complex,
    prior_covariance: NDArray[np.float64] | None = None,
    *,
    heading_referenced: bool = True,
) -> Fix:
    """Return where the receiver stood while it made these observations, by those of each transmitter that hold it.

    `place_sigma_m` says how well each transmitter's own place is known, m: near by, that counts more than noise does.
    Directions from the nose fix less: then what is known of the prior, its covariance, m^2, counts as well.
    Raises PositioningError when they do not fix one place.
    """
    if not heading_referenced:
        observations = _turned_alike(observations)
    heard = {name: [o for o in observations if name in o.directions_rad] for name in transmitters}
    rounded_rad = _OF_A_STEP * max(o.resolution_rad for o in observations)
    directions = {
        name: typical_direction([o.directions_rad[name] for o in of_one], rounded_rad) for name, of_one in heard.items()
    }
    noise = {
        name: math.hypot(of_one[-1].sigma_rad[name] / math.sqrt(len(of_one)), rounded_rad)
        for name, of_one in heard.items()
    }

    def located(sway_m: float) -> Fix:
        sigma = {
            name: math.hypot(noise[name], math.hypot(place_sigma_m[name], sway_m) / abs(at - prior))
            for name, at in transmitters.items()
        }
        if heading_referenced:
            return locate_by_bearings(directions, transmitters, sigma, prior)
        return locate_by_subtended_angles(directions, transmitters, sigma, prior, prior_covariance)

    for sway_m in _SWAYS_M[:-1]:
        with contextlib.suppress(PositioningError):
            return located(sway_m)
    return located(_SWAYS_M[-1])


def _turned_alike(observations: Sequence[Observation]) -> list[Observation]:
    """Return observations as if the nose had always pointed at one transmitter: it yaws while a receiver hovers.

    It is the one heard most often; observations without it are left out.
    """
    heard = [name for observation in observations for name in observation.directions_rad]
    ahead = max(heard, key=heard.count, default="")
    return [
        replace(o, directions_rad={name: wrap(at - o.directions_rad[ahead]) for name, at in o.directions_rad.items()})
        for o in observations
        if ahead in o.directions_rad
    ]


def typical_direction(directions_rad: Sequence[float], rounded_rad: float = 0.0) -> float:
    """Return the mean of directions, rad, without those far from their median: a multipath jump must not count.

    `rounded_rad` is the standard deviation of what rounding has done to them.
    """
    about = np.asarray(directions_rad)
    apart = wrap_all(about[:, None] - about)
    middle = about[int(np.argmin(np.median(np.abs(apart), axis=0)))]
    offsets = wrap_all(about - middle)
    offsets = wrap_all(offsets - np.median(offsets))
    spread = max(_MAD_TO_SIGMA * float(np.median(np.abs(offsets))), _LEAST_SPREAD_RAD, rounded_rad)
    kept = about[np.abs(offsets) <= _OUTLIER_SIGMAS * spread]
    return wrap(float(kept[0] + np.mean(wrap_all(kept - kept[0]))))
