"""The facts of a run, run.json: when it began by its own clock, how it was started, and with which versions."""

from __future__ import annotations

from typing import Annotated, Final

import msgspec

FILE: Final = "run.json"


class RunFacts(msgspec.Struct, frozen=True):
    """What a run has to be explained with later. `sitl` names the autopilot's own simulator it was flown on."""

    started_ns: Annotated[int, msgspec.Meta(ge=0, lt=4_102_444_800_000_000_000)]  # before 2100
    speedup: float
    seed: int
    sitl: str | None
    versions: dict[str, str]
