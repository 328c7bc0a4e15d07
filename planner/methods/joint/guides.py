"""The two best guides of every trip among the stations that transmit so far, kept up to date one station at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.methods.joint.trips import USELESS, Indices, Reals, Trips, length_ratio


@dataclass(frozen=True)
class BestGuides:
    """The two smallest of p, q, 1/p and 1/q and whose they are; both arrays have shape (4, 2, r)."""

    tangent: Reals
    station: NDArray[np.intp]

    def joined_by(self, station: int, tangents: Reals) -> BestGuides:
        """Return the best guides once `station` transmits as well; `tangents` are its own, shape (4, r)."""
        best, second = self.tangent[:, 0], self.tangent[:, 1]
        leads, follows = tangents < best, tangents < second
        whose_best, whose_second = self.station[:, 0], self.station[:, 1]
        return BestGuides(
            np.stack([np.where(leads, tangents, best), np.where(leads, best, np.where(follows, tangents, second))], 1),
            np.stack(
                [
                    np.where(leads, station, whose_best),
                    np.where(leads, whose_best, np.where(follows, station, whose_second)),
                ],
                1,
            ),
        )

    def length_ratio(self) -> Reals:
        """Return the length ratio of each trip by its best two different guides, HOPELESS where there are none."""
        best, second = self.tangent[:, 0], self.tangent[:, 1]
        same = self.station[0::2, 0] == self.station[1::2, 0]
        product = np.where(
            same, np.minimum(best[0::2] * second[1::2], second[0::2] * best[1::2]), best[0::2] * best[1::2]
        )
        return length_ratio(product.min(axis=0))


def first_guides(trips: Trips) -> BestGuides:
    """Return the best guides while only the first transmitters transmit."""
    shape = (4, 2, trips.receiver.size)
    guides = BestGuides(np.full(shape, USELESS), np.full(shape, -1, dtype=np.intp))
    for station in range(len(trips.problem.transmitters)):
        guides = guides.joined_by(station, trips.tangents[:, :, station])
    return guides


def ranked_pairs(tangents: Reals, per_side: int) -> tuple[Indices, Indices]:
    """Return ordered pairs of different guides as two index arrays, the straightest route first.

    `tangents` has shape (4, t). Of every kind only the `per_side` smallest are paired.
    """
    kept = min(per_side, tangents.shape[1])
    best = np.argpartition(tangents, kept - 1, axis=1)[:, :kept]
    first = np.concatenate([np.repeat(best[side], kept) for side in (0, 2)])
    second = np.concatenate([np.tile(best[side + 1], kept) for side in (0, 2)])
    product = np.concatenate(
        [np.outer(tangents[side, best[side]], tangents[side + 1, best[side + 1]]).ravel() for side in (0, 2)]
    )
    usable = np.flatnonzero((first != second) & (product < 1.0))
    order = usable[np.argsort(product[usable], kind="stable")]
    return first[order], second[order]
