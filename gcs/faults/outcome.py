"""One relay flown with faults, as a value: what struck, what became of it, and what the observer found."""

from __future__ import annotations

import random
from typing import Final, Literal

import msgspec

from gcs.errors import leaves
from gcs.faults.fault import Fault, draw_faults
from gcs.faults.findings import Finding
from gcs.faults.world import FaultyWorld
from gcs.playbook.schema import Playbook
from gcs.relay.states import ReceiverState
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from planner.plan import RelayPlan

_LONGEST_S: Final = 900.0
_LONGEST_MAKESPANS: Final = 20.0


class FaultRun(msgspec.Struct, frozen=True):
    """One run. `struck_s` says when each fault struck, None where its moment never came."""

    seed: int
    attended: bool
    faults: list[Fault]
    struck_s: list[float | None]
    outcome: Literal["formed", "held", "broken", "killed"]
    reason: str
    duration_s: float
    closest_m: float | None
    wrong_placements: int
    """Receivers PLACED too far from their slots by lies that the bearings heard there do not contradict."""
    doubted_placements: int
    """Those of them on whose legs directions had contradicted each other or the motion for a while."""
    violations: list[Finding]


def fly_with_faults(playbook: Playbook, plan: RelayPlan, seed: int) -> FaultRun:
    """Fly a relay with the faults of a seed in virtual time; whatever it ends in is in the value returned."""
    attended = random.Random(f"{seed}/attended").random() < 0.5  # noqa: S311 - noise, not secrets
    return fly_faults(playbook, plan, seed, draw_faults(plan, seed), attended=attended)


def fly_faults(
    playbook: Playbook, plan: RelayPlan, seed: int, faults: tuple[Fault, ...], *, attended: bool = False
) -> FaultRun:
    """Fly a relay with these faults; the seed is that of noise and gusts."""
    return run_virtually(_fly(playbook, plan, seed, faults, attended))


async def _fly(playbook: Playbook, plan: RelayPlan, seed: int, faults: tuple[Fault, ...], attended: bool) -> FaultRun:
    clock = VirtualClock()
    world = FaultyWorld(playbook, plan, clock, seed, faults, attended=attended)
    return await watch(world, plan, seed, faults, attended=attended)


async def watch(
    world: FaultyWorld, plan: RelayPlan, seed: int, faults: tuple[Fault, ...], *, attended: bool = False
) -> FaultRun:
    """Run a world to its end and return what was found in it."""
    observer, broken, now_s = world.observer, False, world.clock.now_s
    try:
        await world.run(_LONGEST_S + _LONGEST_MAKESPANS * plan.makespan_s)
    except Exception as error:  # noqa: BLE001 - that nothing ends in one is what is being looked at
        broken = True
        for leaf in leaves(error):
            hangs = isinstance(leaf, TimeoutError)
            observer.findings.add("exception", "", now_s(), "the relay does not end" if hangs else repr(leaf))
    records = world.executor.records.values()
    unplaced = [record.reason for record in records if record.state is not ReceiverState.PLACED]
    closest_m = observer.closest_m
    return FaultRun(
        seed=seed,
        attended=attended,
        faults=list(faults),
        struck_s=[world.moments.struck.get(number) for number in range(len(faults))],
        outcome="broken" if broken else "killed" if world.killed else "held" if unplaced else "formed",
        reason=unplaced[0] if unplaced else "",
        duration_s=now_s(),
        closest_m=None if closest_m == float("inf") else closest_m,
        wrong_placements=world.wrong_placements,
        doubted_placements=world.doubted_placements,
        violations=observer.findings.all,
    )
