"""`measure`: how far the receivers hover from their slots, over a time, into the report."""

from __future__ import annotations

import math
import statistics
from collections import defaultdict
from collections.abc import Sequence

from gcs.playbook.stages import Measure
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run


async def do(run: Run, stage: Measure) -> None:
    """Take the placement figures from what the vehicles tell of their positions; nobody is moved by them."""
    errors_m: dict[str, list[float]] = defaultdict(list)
    separations_m: list[float] = []
    began_s, samples = run.clock.now_s(), max(1, round(stage.for_s / stage.every_s))
    for number in range(1, samples + 1):
        await run.clock.sleep(began_s + number * stage.every_s - run.clock.now_s())
        for record in run.records.values():
            error_m = run.score.placement_error_m(record)
            if error_m is not None:
                errors_m[record.name].append(error_m)
        nearest = (run.board.smallest_separation_m(name) for name in run.board.latest)
        separations_m += [found[0] for found in nearest if found is not None]
    run.measurements.append(
        {
            "stage": run.stage,
            "duration_s": run.clock.now_s() - began_s,
            "samples": samples,
            "min_separation_m": min(separations_m, default=None),
            "receivers": {name: _summary(values_m) for name, values_m in sorted(errors_m.items())},
        }
    )
    worst_m = max((max(values_m) for values_m in errors_m.values()), default=math.nan)
    run.tell(f"measured for {stage.for_s:g} s: at most {worst_m:.2f} m from a slot")


def _summary(values_m: Sequence[float]) -> dict[str, float]:
    return {
        "mean_m": statistics.fmean(values_m),
        "median_m": statistics.median(values_m),
        "rms_m": math.sqrt(statistics.fmean(value * value for value in values_m)),
        "max_m": max(values_m),
    }


def foresee(outlook: Outlook, stage: Measure) -> Foreseen:
    """Return what would be done."""
    names = ", ".join(outlook.playbook.receivers)
    return Foreseen(f"every {stage.every_s:g} s, how far from its slot is {names}", stage.for_s)
