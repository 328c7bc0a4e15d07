"""A dry run in words: every stage, what it would take, and what happens when it fails."""

from __future__ import annotations

from collections.abc import Iterator

from gcs.playbook.stage_rules import NamedStage
from gcs.stages.foresight import Foresight
from gcs.stages.outlook import Foreseen


def foresight_lines(foresight: Foresight) -> Iterator[str]:
    """Yield the stages, each with its parts and what is expected after it, and the totals."""
    for number, (stage, seen) in enumerate(foresight.stages, start=1):
        lasts = "as asked" if seen.duration_s is None else f"{seen.duration_s:.0f} s"
        yield f"{number:3}  {stage.name}: {seen.words} ({', '.join((lasts, *_settings(stage)))})"
        yield from (f"       {part}" for part in _below(stage, seen))
    yield from (f"  at the end expected: {figure} {condition}" for figure, condition in foresight.expect.items())
    yield (
        f"about {foresight.duration_s:.0f} s, {foresight.length_m:.1f} m, "
        f"{foresight.emission_transmitter_s:.0f} transmitter-seconds on {foresight.target}; "
        "nothing was opened, nothing flew"
    )


def _settings(stage: NamedStage) -> Iterator[str]:
    settings = stage.settings
    if settings.timeout_s is not None:
        yield f"at most {settings.timeout_s:g} s"
    if retries := getattr(settings, "retries", 0):
        yield f"tried {retries + 1} times"
    yield f"if it fails: {settings.on_failure}"


def _below(stage: NamedStage, seen: Foreseen) -> Iterator[str]:
    yield from seen.parts
    yield from (f"expected: {figure} {condition}" for figure, condition in stage.settings.expect.items())
