"""Positioning: where a receiver is, from the angles it measures.

The paper's two circles (`two_circle`), any number of directions (`resection`, `robust_fit`), and how good either can
be (`dilution`).
"""

from __future__ import annotations

from planner.dilution import DILUTION_CAP_M_PER_RAD, dilution
from planner.resection import locate_by_bearings, locate_by_subtended_angles
from planner.robust_fit import Fix
from planner.two_circle import (
    ANGLE_TOLERANCE_RAD,
    TwoCircleFixes,
    relative_to_target,
    two_circle,
    two_circle_candidates,
    two_circle_unsigned,
)

__all__ = [
    "ANGLE_TOLERANCE_RAD",
    "DILUTION_CAP_M_PER_RAD",
    "Fix",
    "TwoCircleFixes",
    "dilution",
    "locate_by_bearings",
    "locate_by_subtended_angles",
    "relative_to_target",
    "two_circle",
    "two_circle_candidates",
    "two_circle_unsigned",
]
