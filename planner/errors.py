"""What can go wrong in planning: each error carries the data and the way out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner.plan import RelayPlan


class PlannerError(ValueError):
    """Base of every error the planner raises on purpose."""


class ProblemError(PlannerError):
    """The relay problem itself is not one: too few transmitters, two UAVs in one place, a value out of range."""


class PositioningError(PlannerError):
    """The angles do not fix one position: degenerate, contradictory or ambiguous."""


@dataclass(frozen=True)
class Obstruction:
    """Why one receiver cannot fly to one slot."""

    receiver: str
    slot: str
    reason: str

    def __str__(self) -> str:
        return f"{self.receiver} -> {self.slot}: {self.reason}"


class InfeasiblePlanError(PlannerError):
    """No assignment serves every receiver; `obstructions` says which receiver and slot, and why.

    Where only the accuracy tolerance cannot be met, `best` is the plan that comes nearest to it.
    """

    def __init__(self, obstructions: tuple[Obstruction, ...], way_out: str, best: RelayPlan | None = None) -> None:
        self.obstructions = obstructions
        self.best = best
        self.way_out = way_out
        listed = "\n".join(f"  {obstruction}" for obstruction in obstructions)
        super().__init__(f"no feasible relay plan:\n{listed}\n{way_out}")
