"""The rows of the paper's tables with the printed and the recomputed numbers, and whether they agree.

Lengths are in the paper's units, taken as metres.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.paper.printed import PositioningCase, PrintedPaper
from planner.baselines import Descent
from planner.plan import RelayPlan

TOLERANCE_M = 0.03
ROUNDING_M = 0.005
"""A length printed with two decimals may be off by half of the last one."""
EXACT_BOUND_M = 1e-9
ROUNDED_BOUND_M = 0.007
"""The largest error radius from angles rounded to 0.01 degree: what table 2 prints is of this size."""
_ERROR_RADIUS_DIGIT_M = 1e-4


@dataclass(frozen=True)
class Comparison:
    """A printed length beside the recomputed one, m; a misprint is judged by what it has to read."""

    printed: float
    recomputed: float
    tolerance: float = TOLERANCE_M
    misprint_for: float | None = None

    @property
    def difference(self) -> float:
        """Recomputed minus printed, m."""
        return self.recomputed - self.printed

    @property
    def holds(self) -> bool:
        """Whether the recomputed length is the printed one, within the tolerance."""
        expected = self.printed if self.misprint_for is None else self.misprint_for
        return abs(self.recomputed - expected) <= self.tolerance


@dataclass(frozen=True)
class PositioningResult:
    """One row of table 2: error radii (eq. 25) from exact angles, from rounded ones, and of the printed estimate, m.

    `candidates` is how many positions fit the unsigned angles; the signs of the angles leave one. The trilateration is
    reconstructed, and not held against print.
    """

    printed: PositioningCase
    exact_m: float
    rounded_m: float
    trilateration_exact_m: float
    trilateration_rounded_m: float
    printed_estimate_m: float
    candidates: int

    @property
    def holds(self) -> bool:
        """Whether the error radii keep their bounds, and the printed one is that of the printed estimate."""
        consistent = abs(self.printed_estimate_m - self.printed.error_radius) <= _ERROR_RADIUS_DIGIT_M
        return self.exact_m < EXACT_BOUND_M and self.rounded_m < ROUNDED_BOUND_M and consistent


@dataclass(frozen=True)
class LegsComparison:
    """One cell of table 6."""

    total: Comparison
    first: Comparison
    second: Comparison

    @property
    def holds(self) -> bool:
        """Whether all three lengths hold."""
        return self.total.holds and self.first.holds and self.second.holds


@dataclass(frozen=True)
class ModelsResult:
    """One row of table 6; `chosen` is the shorter model."""

    receiver: str
    chosen: str
    model_1: LegsComparison
    model_2: LegsComparison
    two_step: LegsComparison


@dataclass(frozen=True)
class Passage:
    """How near to one of its guides a route passes, m."""

    model: str
    guide: str
    distance_m: float


@dataclass(frozen=True)
class LengthResult:
    """One row of table 3 or 4.

    `geometric_m` is quoted from print, `geometric_here` its reconstruction; `passages` are those of the shorter (flown)
    model and of the other.
    """

    receiver: str
    length: Comparison
    geometric_m: float
    geometric_here: Descent
    straight_line_m: float
    passages: tuple[Passage, Passage]

    @property
    def quoted_too_short(self) -> bool:
        """Whether the quoted length is shorter than the straight line, and so never reaches the slot."""
        return self.geometric_m < self.straight_line_m - ROUNDING_M


@dataclass(frozen=True)
class LengthsResult:
    """Table 3 or 4, and the relay plan of its starts and slots with separation off.

    The total of the geometric optimization is compared with the sum of its own printed column; what is reconstructed
    of it is not held against print.
    """

    rows: tuple[LengthResult, ...]
    two_step: Comparison
    two_step_column: Comparison
    geometric_column: Comparison
    slots_off_m: float
    plan: RelayPlan

    @property
    def geometric_here_m(self) -> float:
        """Total of the reconstructed geometric optimisation, m."""
        return sum(row.geometric_here.length_m for row in self.rows)

    @property
    def mean_steps(self) -> float:
        """How many steps a receiver takes in the reconstruction, on average."""
        return sum(row.geometric_here.steps for row in self.rows) / len(self.rows)

    @property
    def assignment_is_identity(self) -> bool:
        """Whether the Hungarian method gives receiver i slot i, as the rows of the table do."""
        return [(route.receiver, route.order) for route in self.plan.routes] == [
            (row.receiver, number) for number, row in enumerate(self.rows, 1)
        ]

    @property
    def holds(self) -> bool:
        """Whether rows, totals, slots and assignment are as printed."""
        lengths = [*(row.length for row in self.rows), self.two_step, self.two_step_column, self.geometric_column]
        return (
            all(length.holds for length in lengths) and self.slots_off_m <= TOLERANCE_M and self.assignment_is_identity
        )


@dataclass(frozen=True)
class ModelsTable:
    """Table 6 with its totals."""

    rows: tuple[ModelsResult, ...]
    model_1: Comparison
    model_2: Comparison
    two_step: Comparison

    @property
    def holds(self) -> bool:
        """Whether rows and totals are as printed."""
        cells_hold = all(cell.holds for row in self.rows for cell in (row.model_1, row.model_2, row.two_step))
        return cells_hold and self.model_1.holds and self.model_2.holds and self.two_step.holds


@dataclass(frozen=True)
class PaperComparison:
    """All tables, and the 20-UAV chain that keeps the separation. Table 5 takes its totals from table 3."""

    printed: PrintedPaper
    table_2: tuple[PositioningResult, ...]
    table_3: LengthsResult
    table_4: LengthsResult
    table_5: Comparison
    table_6: ModelsTable
    flyable: RelayPlan

    @property
    def holds(self) -> bool:
        """Whether the paper's numbers hold, printed errors aside."""
        lengths_hold = self.table_3.holds and self.table_4.holds and self.table_5.holds and self.table_6.holds
        return lengths_hold and all(row.holds for row in self.table_2)
