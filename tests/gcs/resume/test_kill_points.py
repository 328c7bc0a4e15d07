"""A service killed anywhere in an eight-UAV run, and another that goes on from its journal: in virtual time."""

from __future__ import annotations

import random
from functools import cache

import pytest

from gcs.recording.journal_reading import entries_of
from gcs.relay.states import ReceiverState
from gcs.resume.state import RunState, run_state
from gcs.simulate.virtual_time import run_virtually
from tests.gcs.resume.killed import CHAIN, LONGEST_S, Left, ServedWorld, planned

KILLS = 16
"""Of each flight."""
FLIGHTS = {"chain": CHAIN, "waves": planned("waves_8")}
"""One after another, and several at once."""
LOST_S = 0.1
"""A line younger than this may be torn by the kill, or lost."""


@cache
def killed(flight: str) -> list[Left]:
    """What each kill leaves, of one and the same flight.

    Half of the kills are anywhere, half of them just after a line of the journal, while it is being written.
    """
    rng = random.Random(20)

    async def fly_through() -> tuple[int, float]:
        world = ServedWorld(planned=FLIGHTS[flight])
        await world.run(LONGEST_S)
        return len(world.lines), world.clock.now_s()

    async def fly_and_look() -> list[Left]:
        return await ServedWorld(planned=FLIGHTS[flight]).left_after([*anywhere, *while_writing])

    lines, end_s = run_virtually(fly_through())
    anywhere = [(0, rng.uniform(0.0, end_s)) for _ in range(KILLS // 2)]
    while_writing = [(rng.randint(1, lines), rng.uniform(0.0, LOST_S)) for _ in range(KILLS // 2)]
    left = run_virtually(fly_and_look())
    assert len(left) == KILLS
    return left


def stood(state: RunState) -> set[str]:
    return {name for name, change in state.receivers.items() if change.state is ReceiverState.PLACED}


def told(left: Left) -> RunState:
    """What the service knew when it was killed, lines that were lost included."""
    return run_state(entries_of(left.journal()).entries)


def assert_formed(world: ServedWorld, stood_before: set[str]) -> None:
    playbook = world.playbook
    assert world.executor.formed, (world.states(), world.said)
    assert max(world.errors_m().values()) < playbook.flight.placement_tolerance_m / 2
    assert [name for name in stood_before if world.counted[name].renewals] == []
    assert world.score.min_separation_m >= playbook.planner.min_separation_m
    after = entries_of([line.text for line in world.lines])
    assert stood(run_state(after.entries)) == set(playbook.receivers)
    assert world.on_air == set()


@pytest.mark.parametrize("flight", FLIGHTS)
@pytest.mark.parametrize("number", range(KILLS))
def test_a_killed_run_goes_on_and_forms_and_nobody_who_stood_flies_again(number: int, flight: str) -> None:
    left, rng = killed(flight)[number], random.Random(number)
    while_writing = bool(left.lines) and left.lines[-1].time_s > left.time_s - LOST_S
    journal = left.journal(rng.random() if while_writing else None)

    async def resume() -> ServedWorld:
        world = ServedWorld(left, journal, rng.uniform(0.0, 8.0), planned=FLIGHTS[flight])
        await world.run(LONGEST_S)
        return world

    older = [line.text for line in left.lines if line.time_s <= left.time_s - LOST_S]
    assert entries_of(journal).entries[: len(older)] == entries_of(older).entries
    assert len(entries_of(journal).lost) == while_writing
    assert_formed(run_virtually(resume()), stood(told(left)))


@pytest.mark.parametrize(("seed", "flight"), [(0, "chain"), (1, "chain"), (2, "waves"), (3, "waves")])
def test_a_run_that_is_killed_again_while_it_is_resumed_goes_on_as_well(seed: int, flight: str) -> None:
    rng, flown = random.Random(seed), FLIGHTS[flight]
    first = killed(flight)[rng.randrange(KILLS)]

    async def resume_and_look() -> Left:
        world = ServedWorld(first, first.journal(), 1.0, planned=flown)
        (left,) = await world.left_after([(len(world.lines), rng.uniform(0.5, 10.0))])
        return left

    async def resume(left: Left) -> ServedWorld:
        world = ServedWorld(left, left.journal(rng.random()), 1.0, planned=flown)
        await world.run(LONGEST_S)
        return world

    second = run_virtually(resume_and_look())
    assert_formed(run_virtually(resume(second)), stood(told(second)))
