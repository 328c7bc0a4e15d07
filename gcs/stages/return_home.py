"""`return`: every vehicle flies home by its own return mode and lands, one after another, clear of those that hover."""

from __future__ import annotations

from collections.abc import Mapping

from gcs.playbook.stages import Return
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run, StageError
from planner.routes import distance_to_segment


async def do(run: Run, _stage: Return) -> None:
    """Let one go at a time whose way home is clear. StageError when none is, and for a pilot's vehicle left alone."""
    frame = run.playbook.site.frame
    homes = {name: frame.to_site(start) for name, start in run.playbook.uavs.items()}
    pilots, waiting = run.pilots(), list(run.flying())
    while waiting:
        hovering = _places(run, [*waiting, *pilots])
        name = next_home(waiting, hovering, homes, run.playbook.planner.min_separation_m)
        if name is None:
            raise StageError(f"{', '.join(waiting)} hover in each other's way home: land them where they are")
        run.tell(f"{name} returns")
        waiting.remove(name)
        run.send(name)
        try:
            await run.autopilots[name].return_home(run.fleet.vehicles[name])
        except BaseException:
            if name in run.flying():
                run.brake(name)
            raise
    if pilots:
        raise StageError(f"{', '.join(pilots)} is its pilot's and was not sent home")


def next_home(
    waiting: list[str], hovering: Mapping[str, complex], homes: Mapping[str, complex], separation_m: float
) -> str | None:
    """Return who can fly straight home past all that hover; None when nobody can. Places in any one frame, m."""
    for name in sorted(waiting, key=lambda name: abs(hovering[name] - homes[name])):
        others = [place for other, place in hovering.items() if other != name]
        if all(distance_to_segment(hovering[name], homes[name], place) >= separation_m for place in others):
            return name
    return None


def _places(run: Run, names: list[str]) -> dict[str, complex]:
    unknown = [name for name in names if name not in run.board.latest]
    if unknown:
        raise StageError(f"{', '.join(unknown)} has told no position: whether ways home are clear cannot be said")
    return {name: run.board.latest[name].north_east for name in names}


def foresee(outlook: Outlook, _stage: Return) -> Foreseen:
    """Return what would be done."""
    flown_s = (at_m / outlook.playbook.flight.speed_mps for at_m in outlook.distances_home_m().values())
    return Foreseen(
        "every vehicle flies home and lands, one after another", sum(each + outlook.return_s for each in flown_s)
    )
