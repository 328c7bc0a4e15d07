"""One simulated relay as a value: what became of it, and how far off everything ended. Metres, seconds."""

from __future__ import annotations

from typing import Final, Literal

import msgspec

from gcs.playbook.schema import Playbook
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import ReceiverState
from gcs.simulate.bus import LocalBus
from gcs.simulate.scored import ScoredWorld
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from gcs.simulate.world import Stop
from planner.plan import RelayPlan

Outcome = Literal["formed", "held", "timeout"]

HOVER_S: Final = 10.0
"""How long all hover on after the relay, for the mean place of each."""
_LONGEST_S: Final = 600.0
_LONGEST_MAKESPANS: Final = 20.0


class ReceiverResult(msgspec.Struct, frozen=True):
    """One receiver of one run; None where it did not get so far."""

    name: str
    slot: str
    state: str
    reason: str
    planned_length_m: float
    flown_length_m: float
    predicted_3sigma_m: float | None
    placement_error_m: float | None
    """From its slot, when the relay had ended."""
    hover_error_m: float | None
    """The same of its mean place while it hovered on: without its sway in gusts."""
    stop_error_m: float | None
    """Along its last leg from where its stop angle is seen, when it was PLACED; positive beyond."""
    overshoot_m: float | None
    """How far it ran along its last leg beyond where it stood when it was PLACED."""
    duration_s: float | None
    """From being located until PLACED."""


class RunResult(msgspec.Struct, frozen=True):
    """One run. `reason` is that of the first receiver that is not PLACED."""

    seed: int
    outcome: Outcome
    reason: str
    duration_s: float
    emission_transmitter_s: float
    min_separation_m: float | None
    receivers: list[ReceiverResult]

    @property
    def flown_length_m(self) -> float:
        """What all receivers flew."""
        return sum(receiver.flown_length_m for receiver in self.receivers)


def fly_once(playbook: Playbook, plan: RelayPlan, seed: int, stop: Stop = "filtered") -> RunResult:
    """Fly a relay plan in virtual time, noise and gusts drawn from a seed, and return what became of it."""
    return run_virtually(_fly_once(playbook, plan, seed, stop))


async def _fly_once(playbook: Playbook, plan: RelayPlan, seed: int, stop: Stop) -> RunResult:
    clock = VirtualClock()
    world = ScoredWorld(playbook, plan, clock, LocalBus(), seed=seed, stop=stop)
    began_s, timed_out = clock.now_s(), False
    try:
        await world.run(_LONGEST_S + _LONGEST_MAKESPANS * plan.makespan_s)
    except TimeoutError:
        timed_out = True
    duration_s, errors_m = clock.now_s() - began_s, world.errors_m()
    await world.hover(HOVER_S)
    records = world.executor.records.values()
    return RunResult(
        seed=seed,
        outcome="timeout" if timed_out else "formed" if world.executor.formed else "held",
        reason=next((record.reason for record in records if record.state is not ReceiverState.PLACED), ""),
        duration_s=duration_s,
        emission_transmitter_s=world.emission.transmitter_s(),
        min_separation_m=world.score.min_separation_m,
        receivers=[_receiver(world, record, errors_m[record.name]) for record in records],
    )


def _receiver(world: ScoredWorld, record: ReceiverRecord, error_m: float) -> ReceiverResult:
    score, placed = world.scores[record.name], record.state is ReceiverState.PLACED
    began_s, placed_s = score.began_s, score.placed_s
    lengths_m = [length_m for (name, _), length_m in world.score.leg_lengths_m.items() if name == record.name]
    return ReceiverResult(
        name=record.name,
        slot=record.route.slot,
        state=record.state.value,
        reason="" if placed else record.reason,
        planned_length_m=world.plan.route_of(record.name).length_m,
        flown_length_m=sum(lengths_m),
        predicted_3sigma_m=world.plan.route_of(record.name).predicted_3sigma_m,
        placement_error_m=error_m if placed else None,
        hover_error_m=abs(sum(score.hovered) / len(score.hovered) - record.route.target) if placed else None,
        stop_error_m=score.stop_error_m if placed else None,
        overshoot_m=score.overshoot_m if placed else None,
        duration_s=placed_s - began_s if placed and placed_s is not None and began_s is not None else None,
    )
