"""Planning methods: one module each, one line each in the registry."""

from __future__ import annotations

from collections.abc import Callable

from planner.methods import joint, paper
from planner.plan import RelayPlan
from planner.relay import RelayProblem

PlanningMethod = Callable[[RelayProblem], RelayPlan]

METHODS: dict[str, PlanningMethod] = {
    "paper": paper.plan,
    "joint": joint.plan,
}

DEFAULT_METHOD = "joint"
