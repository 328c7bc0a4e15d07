"""Locating a hovering receiver: which transmitters it should hear, and what many reports of them say together."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Final

import numpy as np

from gcs.bearings import Observation, Observations
from planner.angles import wrap, wrap_all
from planner.errors import PositioningError
from planner.positioning import Fix, dilution, locate_by_bearings

WANTED_DILUTION_M_PER_RAD: Final = 400.0
"""Above this a fix is blurred (7 m per degree): one more transmitter is switched on."""

_MAD_TO_SIGMA: Final = 1.4826
_OUTLIER_SIGMAS: Final = 4.0
_SWAYS_M: Final = (0.1, 0.3, 1.0)
"""How far what stands in the air may sway: in calm air, and where directions contradict each other without wind."""
_MOST_REPORTS: Final = 4
"""So many reports are waited for, for each sample."""
_LEAST_SPREAD_RAD: Final = math.radians(0.01)


def transmitters_to_hear(place: complex, needed: Collection[str], standing: Mapping[str, complex]) -> frozenset[str]:
    """Return the transmitters to locate a receiver by that is near `place`, m.

    Those its route needs anyway; where they fix the place badly, also those of the standing ones that sharpen it most,
    until two are heard and the dilution is as wanted or nothing helps any more.
    """
    heard = set(needed)
    others = set(standing) - heard
    while others:
        blur = _dilution(place, heard, standing)
        if len(heard) >= 2 and blur <= WANTED_DILUTION_M_PER_RAD:
            break
        best = min(sorted(others), key=lambda name: _dilution(place, heard | {name}, standing))
        if len(heard) >= 2 and _dilution(place, heard | {best}, standing) > 0.9 * blur:
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
) -> Fix:
    """Return where the receiver stood while it made these observations, by those of each transmitter that hold it.

    `place_sigma_m` says how well each transmitter's own place is known, m: near by, that counts more than noise does.
    Raises PositioningError when they do not fix one place.
    """
    heard = {name: [o for o in observations if name in o.directions_rad] for name in transmitters}
    directions = {name: typical_direction([o.directions_rad[name] for o in of_one]) for name, of_one in heard.items()}
    noise = {name: of_one[-1].sigma_rad[name] / math.sqrt(len(of_one)) for name, of_one in heard.items()}

    def located(sway_m: float) -> Fix:
        sigma = {
            name: math.hypot(noise[name], math.hypot(place_sigma_m[name], sway_m) / abs(at - prior))
            for name, at in transmitters.items()
        }
        return locate_by_bearings(directions, transmitters, sigma, prior=prior)

    for sway_m in _SWAYS_M[:-1]:
        with contextlib.suppress(PositioningError):
            return located(sway_m)
    return located(_SWAYS_M[-1])


def typical_direction(directions_rad: Sequence[float]) -> float:
    """Return the mean of directions, rad, without those far from their median: a multipath jump must not count."""
    about = np.asarray(directions_rad)
    apart = wrap_all(about[:, None] - about)
    middle = about[int(np.argmin(np.median(np.abs(apart), axis=0)))]
    offsets = wrap_all(about - middle)
    offsets = wrap_all(offsets - np.median(offsets))
    spread = max(_MAD_TO_SIGMA * float(np.median(np.abs(offsets))), _LEAST_SPREAD_RAD)
    kept = about[np.abs(offsets) <= _OUTLIER_SIGMAS * spread]
    return wrap(float(kept[0] + np.mean(wrap_all(kept - kept[0]))))


def _dilution(place: complex, heard: Collection[str], standing: Mapping[str, complex]) -> float:
    """Return the GDOP of the transmitters heard, m/rad; infinite for fewer than two."""
    if len(heard) < 2:
        return math.inf
    return float(dilution(place, [standing[name] for name in sorted(heard)], heading_referenced=True))
