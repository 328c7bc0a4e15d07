"""The dry run of a playbook: every stage foreseen, one after another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gcs.expectations import Condition
from gcs.playbook.schema import Playbook
from gcs.playbook.stage_rules import NamedStage
from gcs.playbook.target import aimed
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.registry import STAGES
from planner.plan import RelayPlan


@dataclass(frozen=True)
class Foresight:
    """What would be done. Durations and emission are without what waits for the operator."""

    target: str
    stages: tuple[tuple[NamedStage, Foreseen], ...]
    duration_s: float
    length_m: float
    emission_transmitter_s: float
    expect: Mapping[str, Condition]


def foresee(playbook: Playbook, plan: RelayPlan) -> Foresight:
    """Return what a playbook would do with a plan; nothing is opened, nothing flies."""
    outlook = Outlook(playbook, plan)
    stages, duration_s, emission_s = [], 0.0, 0.0
    for stage in playbook.flow:
        seen = STAGES[stage.kind].foresee(outlook, stage.settings)
        lasts_s, own_s = seen.duration_s or 0.0, seen.emission_transmitter_s
        duration_s += lasts_s
        emission_s += lasts_s * len(outlook.kept_on) if own_s is None else own_s
        stages.append((stage, seen))
    target = aimed(playbook).target or ""
    length_m = plan.total_length_m if any(stage.kind == "relay" for stage in playbook.flow) else 0.0
    return Foresight(target, tuple(stages), duration_s, length_m, emission_s, playbook.expect)
