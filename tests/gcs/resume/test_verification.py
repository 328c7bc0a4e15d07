"""What is found when a run goes on: who has moved, who is not heard, whom a pilot has."""

from __future__ import annotations

import pytest

from drivers.mavlink.setpoints import StreamState
from drivers.tasks import background
from gcs.simulate.virtual_time import run_virtually
from tests.gcs.resume.killed import LONGEST_S, Left, ServedWorld

PILOTED = b'{"time_ns": 1, "receiver": "U2", "state": "PILOT"}'


@pytest.fixture(scope="module")
def left() -> Left:
    """U1 and U2 stand, and U3 is on its first leg."""

    async def fly() -> Left:
        (left,) = await ServedWorld().left_after([(10, 4.0)])
        return left

    return run_virtually(fly())


def went_on(left: Left, change=lambda world: None, more: bytes = b"") -> ServedWorld:
    """The world after another service has gone on in it, once it and its journal have been changed."""
    return left_by(left, change, more)[0]


def left_by(left: Left, change=lambda world: None, more: bytes = b"") -> tuple[ServedWorld, Left]:
    """The same, and what it leaves in its turn."""

    async def resume() -> tuple[ServedWorld, Left]:
        world = ServedWorld(left, [*left.journal(), *filter(None, [more])], 5.0)
        change(world)
        await world.run(LONGEST_S)
        return world, world.left()

    return run_virtually(resume())


def nobody_flew(world: ServedWorld) -> bool:
    return not any(lease.renewals for lease in world.counted.values())


def test_nobody_counts_as_a_transmitter_before_it_is_verified(left: Left) -> None:
    needed: list[frozenset[str]] = []

    def watch(world: ServedWorld) -> None:
        need = world.emission.need

        def noting(receiver: str, names) -> None:
            if names:
                needed.append(frozenset(names))
                assert frozenset(names) <= world.executor.standing.places.keys()
            need(receiver, names)

        world.emission.need = noting

    world = went_on(left, watch)
    assert world.executor.formed
    assert needed[0] == {"L0", "L1"}
    assert world.restored.unverified == ("U1", "U2", "U3")


def test_one_that_stood_and_is_somewhere_else_is_held_and_flies_when_it_is_resumed_again(left: Left) -> None:
    def blow_away(world: ServedWorld) -> None:
        world.vehicles["U1"].place += 8.0 - 9.0j

    world, then = left_by(left, blow_away)
    assert world.states()["U1"] == "HELD"
    assert "it was PLACED, and bearings put it" in world.executor.records["U1"].reason
    assert "m from O1 (allowed are" in world.executor.records["U1"].reason
    assert nobody_flew(world)
    assert not world.executor.formed
    again = went_on(then)
    assert again.executor.formed
    assert again.errors_m()["U1"] < 1.0
    assert again.counted["U1"].renewals
    assert not again.counted["U2"].renewals


def test_one_that_is_not_heard_is_held_and_nobody_flies(left: Left) -> None:
    world = went_on(left, lambda world: world.silenced.add("U2"))
    assert (world.states()["U1"], world.states()["U2"], world.states()["U3"]) == ("PLACED", "HELD", "HELD")
    assert "check its sensor and the transmitters" in world.executor.records["U2"].reason
    assert nobody_flew(world)


def test_a_transmitter_that_a_pilot_has_now_is_not_counted_on(left: Left) -> None:
    world = went_on(left, lambda world: world.vehicles["U2"].take_over())
    assert world.states()["U2"] == "PILOT"
    assert "U2" not in world.executor.standing.places
    assert nobody_flew(world), "U3 is planned with U2"


def test_one_that_was_its_pilot_s_stays_so_in_whatever_mode_it_is(left: Left) -> None:
    world = went_on(left, more=PILOTED)
    assert world.states()["U2"] == "PILOT"
    assert world.vehicles["U2"].state is StreamState.PILOT
    assert nobody_flew(world)


def test_it_goes_on_once_the_operator_has_released_and_resumed(left: Left) -> None:
    async def resume() -> ServedWorld:
        world = ServedWorld(left, [*left.journal(), PILOTED], 5.0, attended=True)

        async def operate() -> None:
            while not world.executor.waiting:
                await world.clock.sleep(0.5)
            assert world.counted["U2"].release() is None
            world.executor.look()
            world.executor.resume()

        async with background(operate()):
            await world.run(LONGEST_S)
        return world

    world = run_virtually(resume())
    assert world.executor.formed
    assert not world.counted["U1"].renewals


@pytest.mark.parametrize("landed_by_its_pilot", [False, True])
def test_without_one_that_stood_the_others_find_another_way(left: Left, landed_by_its_pilot: bool) -> None:
    def take_over(world: ServedWorld) -> None:
        if landed_by_its_pilot:
            world.vehicles["U2"].take_over()

    world = went_on(left, take_over, b'{"time_ns": 1, "relay": "skip U2", "known": {"taken": [], "given_up": ["U2"]}}')
    assert world.states().pop("U2") == "FAILED"
    assert {state for name, state in world.states().items() if name != "U2"} == {"PLACED"}
    assert not world.counted["U2"].renewals
