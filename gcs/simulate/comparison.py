"""A comparison: the relay beside the paper's, flown with the same seeds. What is compared, and its JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from gcs.playbook.schema import Playbook
from gcs.simulate.outcome import RunResult
from gcs.simulate.study import Study
from gcs.simulate.summary import summary
from gcs.simulate.world import Stop

SLOW_MPS: Final = 1.0
"""The paper's raw stop is flown at this speed too: it is as good as it gets, and as slow."""
_OF_FORMED: Final = ("flown_length_m", "duration_s", "emission_transmitter_s")


@dataclass(frozen=True)
class Arm:
    """One of those compared."""

    name: str
    title: str
    study: Study

    def within_tolerance(self, results: Sequence[RunResult]) -> int:
        """Return how many runs formed with every receiver within the placement tolerance of its slot."""
        tolerance_m = self.study.playbook.flight.placement_tolerance_m
        errors_m = [[receiver.placement_error_m for receiver in run.receivers] for run in results]
        return sum(all(error_m is not None and error_m <= tolerance_m for error_m in of_run) for of_run in errors_m)


def arms_of(playbook: Playbook) -> list[Arm]:
    """Return what a playbook is compared with: itself first, then the paper's chain and raw stop.

    PlannerError when it has no plan by the paper's method.
    """
    speed_mps = playbook.flight.speed_mps
    papers = playbook.model_copy(update={"planner": playbook.planner.model_copy(update={"method": "paper"})})
    arms = [_arm("relay", "this relay", playbook, "filtered"), _arm("paper", "the paper's", papers, "raw")]
    if speed_mps > SLOW_MPS:
        slow = papers.model_copy(update={"flight": papers.flight.model_copy(update={"speed_mps": SLOW_MPS})})
        arms.append(_arm("paper-slow", f"the paper's, at {SLOW_MPS:g} m/s", slow, "raw"))
    return arms


def comparison(arms: Sequence[Arm], results: Mapping[str, Sequence[RunResult]]) -> dict[str, Any]:
    """Return the documented JSON: the summary of each arm, by its name, with what was flown."""
    return {arm.name: _told(arm, results[arm.name]) for arm in arms}


def formed_only(results: Sequence[RunResult]) -> list[RunResult]:
    """Return the runs that formed: only their lengths and times can be compared."""
    return [run for run in results if run.outcome == "formed"]


def _arm(name: str, title: str, playbook: Playbook, stop: Stop) -> Arm:
    return Arm(name, title, Study(playbook, playbook.plan(), stop))


def _told(arm: Arm, results: Sequence[RunResult]) -> dict[str, Any]:
    study, formed = arm.study, summary(formed_only(results))
    return {
        "method": study.plan.method,
        "stop": study.stop,
        "speed_mps": study.playbook.flight.speed_mps,
        "planned_length_m": study.plan.total_length_m,
        "within_tolerance": arm.within_tolerance(results),
        "of_formed": {key: formed[key] for key in _OF_FORMED},
        **summary(results),
    }
