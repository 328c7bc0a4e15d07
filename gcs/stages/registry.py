"""Every kind of stage: what does it, and what foresees it. A new one is a module beside this one, and a line here."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from gcs.stages import (
    arm,
    connect,
    emission,
    hold,
    inject,
    land,
    locate,
    measure,
    plan,
    preflight,
    prompt,
    relay,
    return_home,
    takeoff,
    wait,
)
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run


@dataclass(frozen=True)
class StageKind:
    """One kind: `do` raises what went wrong, known errors alone or in a group; both take the stage's own settings."""

    do: Callable[[Run, Any], Awaitable[None]]
    foresee: Callable[[Outlook, Any], Foreseen]


STAGES: Final[Mapping[str, StageKind]] = MappingProxyType(
    {
        "connect": StageKind(connect.do, connect.foresee),
        "preflight": StageKind(preflight.do, preflight.foresee),
        "arm": StageKind(arm.do, arm.foresee),
        "takeoff": StageKind(takeoff.do, takeoff.foresee),
        "locate": StageKind(locate.do, locate.foresee),
        "plan": StageKind(plan.do, plan.foresee),
        "relay": StageKind(relay.do, relay.foresee),
        "hold": StageKind(hold.do, hold.foresee),
        "measure": StageKind(measure.do, measure.foresee),
        "return": StageKind(return_home.do, return_home.foresee),
        "land": StageKind(land.do, land.foresee),
        "wait": StageKind(wait.do, wait.foresee),
        "prompt": StageKind(prompt.do, prompt.foresee),
        "emission": StageKind(emission.do, emission.foresee),
        "inject": StageKind(inject.do, inject.foresee),
    }
)
"""By the words of a playbook."""
