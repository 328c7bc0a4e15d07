"""After its legs a receiver is verified; where bearings put it off its slot for certain, a trim leg takes it back."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby

import numpy as np
import pytest

from gcs.relay.journey import MOST_TRIMS
from gcs.relay.leg_flight import DISBELIEVED
from gcs.relay.states import ReceiverState
from tests.gcs.relay.world import World

VERIFYING, TRIMMING, PLACED = ReceiverState.VERIFYING, ReceiverState.TRIMMING, ReceiverState.PLACED


def states_of(world: World, name: str) -> list[ReceiverState]:
    """Return the states a receiver went through, each once."""
    return [state for state, _ in groupby(state for _, at, state, _ in world.history if at == name)]


def shoving(world: World, name: str, by_m: complex, times: int) -> Callable[[float], None]:
    """Return what shoves a receiver each time its verification begins."""
    seen = 0

    def meanwhile(_: float) -> None:
        nonlocal seen
        if states_of(world, name).count(VERIFYING) > seen:
            seen += 1
            if seen <= times:
                world.vehicles[name].place += by_m

    return meanwhile


@pytest.mark.parametrize("shove", [1.2 + 0j, -0.6 + 0.8j])
async def test_who_was_shoved_off_its_slot_is_brought_back(shove: complex) -> None:
    world = World(sigma_deg=0.1)
    world.executor.records = {"U1": world.executor.records["U1"]}
    await world.run(meanwhile=shoving(world, "U1", shove, times=1))
    states = states_of(world, "U1")
    assert states.count(TRIMMING) >= 1
    assert states[-2:] == [VERIFYING, PLACED]
    assert world.errors_m()["U1"] < 0.5


async def test_who_is_found_where_it_cannot_have_flown_to_is_held_until_the_operator_has_it_located_anew() -> None:
    world = World(sigma_deg=0.1, attended=True)
    world.executor.records = {"U1": world.executor.records["U1"]}
    record, shove, reasons = world.executor.records["U1"], shoving(world, "U1", -0.8 + 1.1j, times=1), []

    def meanwhile(now_s: float) -> None:
        shove(now_s)
        if record.state is ReceiverState.HELD and not reasons:
            reasons.append(record.reason)
            world.executor.resume()

    await world.run(meanwhile=meanwhile, until=lambda: record.state is PLACED)
    assert reasons == [DISBELIEVED]
    believed = world.executor.standing.places["U1"]  # in its slot within the tolerance, and known where
    assert abs(world.frame.to_site(believed) - world.vehicles["U1"].place) < 0.6


async def test_who_cannot_stay_trims_no_longer_than_it_helps() -> None:
    world = World(sigma_deg=0.1)
    world.executor.records = {"U1": world.executor.records["U1"]}
    await world.run(meanwhile=shoving(world, "U1", 1.2 + 0j, times=99))
    assert states_of(world, "U1").count(TRIMMING) == MOST_TRIMS
    assert states_of(world, "U1")[-1] is PLACED  # within the tolerance of 3 m, and believed to be where it is
    believed = world.executor.standing.places["U1"]
    assert abs(world.frame.to_site(believed) - world.vehicles["U1"].place) < 0.6


async def test_who_is_shoved_out_of_the_tolerance_again_and_again_is_held() -> None:
    world = World(sigma_deg=0.1)
    world.executor.records = {"U1": world.executor.records["U1"]}
    await world.run(meanwhile=shoving(world, "U1", 6 + 0j, times=99))
    record = world.executor.records["U1"]
    assert record.state is ReceiverState.HELD
    assert "from O1 (allowed are" in record.reason


async def test_places_are_believed_better_than_one_look_tells() -> None:
    """Half a degree of noise: what the leg knows counts with what is heard at its end."""
    off_m = []
    for seed in (1, 2, 3):
        world = World(sigma_deg=0.5, seed=seed)
        await world.run()
        assert world.executor.formed
        places = world.executor.standing.places
        off_m += [
            abs(world.frame.to_site(places[name]) - world.vehicles[name].place) for name in world.executor.records
        ]
    assert np.median(off_m) < 0.3
