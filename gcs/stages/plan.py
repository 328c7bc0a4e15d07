"""`plan`: plan the relay anew, from where the receivers were located."""

from __future__ import annotations

import asyncio
from dataclasses import replace

from gcs.playbook.stages import Plan
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run
from planner.methods import METHODS


async def do(run: Run, _stage: Plan) -> None:
    """Plan from where they are, or else from their starts. PlannerError when there is no plan."""
    planner = run.playbook.planner
    problem = run.playbook.problem()
    problem = replace(problem, receivers={**problem.receivers, **run.located})
    made = await asyncio.to_thread(METHODS[planner.method], problem)
    run.adopt(made)
    run.tell(f"planned from where they were located: {made.total_length_m:.1f} m, {made.makespan_s:.0f} s")


def foresee(outlook: Outlook, _stage: Plan) -> Foreseen:
    """Return what would be done."""
    length_m, method = outlook.plan.total_length_m, outlook.plan.method
    return Foreseen(f"by {method}, from where they are located; from their starts {length_m:.1f} m", 0.0)
