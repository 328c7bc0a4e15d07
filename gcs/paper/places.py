"""The printed places as points: formation frame, or about A of table 2 with the axis towards B; m."""

from __future__ import annotations

import cmath
import math

from gcs.paper.printed import Polar, Positioning, PositioningCase


def point(place: Polar) -> complex:
    """Return a printed place (m, degrees) as a point."""
    return cmath.rect(place[0], math.radians(place[1]))


def triangle(setting: Positioning) -> tuple[complex, complex, complex]:
    """Return the transmitters A, B and C of table 2."""
    return 0j, complex(setting.b), point(setting.c)


def receiver(setting: Positioning, case: PositioningCase) -> complex:
    """Return D of a row of table 2, printed about the target O with the axis A-O."""
    target = point(setting.target)
    return target + point(case.position) * target / abs(target)
