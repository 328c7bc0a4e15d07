"""The pilot has the last word and the operator the next: whole relays in virtual time, held, released and resumed."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial

import pytest

from drivers.mavlink.setpoints import StreamState
from gcs.relay.states import ReceiverState
from planner.methods import METHODS
from tests.gcs.relay.operating import after, done, in_turn, reached, refused
from tests.gcs.relay.world import PERIOD_S, World

S = ReceiverState


def waves() -> World:
    """Eight receivers, several in the air at the same time."""
    problem = replace(World().playbook.problem(), objective="balanced")
    return World(sigma_deg=0.1, plan=METHODS["joint"](problem), attended=True)


def flying(world: World) -> list[str]:
    return [name for name, state in world.states().items() if state in (S.LOCATING, S.LEG_1, S.LEG_2, S.VERIFYING)]


def settled_within(world: World, tolerance_m: float = 1.5) -> None:
    assert world.executor.formed
    assert max(world.errors_m().values()) < tolerance_m


def stood_within(world: World, name: str, tolerance_m: float = 1.5) -> None:
    """One stands in its slot, and the relay has gone on from it."""
    assert world.states()[name] is S.PLACED
    assert world.errors_m()[name] < tolerance_m
    assert world.executor.held is None


async def test_a_pilot_takes_one_in_mid_leg_and_it_comes_back_to_its_slot() -> None:
    world = waves()
    taken = world.vehicles["U4"]

    def take() -> None:
        assert len(flying(world)) > 2
        taken.take_over()

    def all_hold() -> None:
        assert world.states()["U4"] is S.PILOT
        held = [name for name, state in world.states().items() if state is S.HELD]
        assert held
        assert not flying(world)
        assert not world.on_air
        for name in held:
            assert world.vehicles[name].command == 0j
            assert "U4 was taken over" in world.executor.records[name].reason
        assert "release U4" in refused(world, "resume")
        assert "guided mode" in refused(world, "release U4")
        words = [f"bearing-relay control {word}" for word in ("release U4", "skip U4", "abort")]
        assert world.executor.ways_out() == words
        taken.place += 12 - 25j  # its pilot parks it elsewhere

    def give_back() -> None:
        assert world.states()["U4"] is S.PILOT
        taken.guided = True
        world.objections["U4"] = "only 2.0 m from U5"
        assert "resume" in done(world, "release U4")
        world.objections.clear()
        assert world.states()["U4"] is S.HELD

    def go_on() -> None:
        assert world.states()["U4"] is S.HELD  # released is not flying
        assert not any(vehicle.command for vehicle in world.vehicles.values())
        done(world, "resume")
        assert refused(world, "resume") == "nothing is held"

    renewed_before: list[float] = []

    def watch() -> None:
        renewed_before.extend(taken.renewals)

    script = in_turn(
        (reached(world, "U4", S.LEG_1, for_s=3.0), take),
        (after(world, 0.2), all_hold),
        (after(world, 20.0), watch),
        (lambda: True, give_back),
        (after(world, 5.0), go_on),
    )
    await world.run(meanwhile=script)
    settled_within(world)
    changes = [state for _, name, state, _ in world.history if name == "U4"]
    assert changes.index(S.PILOT) < changes.index(S.HELD) < len(changes) - 1 - changes[::-1].index(S.LOCATING)
    back_s = next(time_s for time_s, name, state, _ in world.history if name == "U4" and state is S.HELD)
    assert taken.renewals[len(renewed_before)] > back_s + 5.0


async def test_held_in_any_state_and_resumed_the_relay_forms() -> None:
    world = World(sigma_deg=0.1)  # unattended: who holds is there
    states = {"U2": S.LOCATING, "U3": S.LEG_1, "U4": S.LEG_2, "U5": S.VERIFYING}

    def hold(name: str) -> None:
        assert name in done(world, "hold")
        assert world.states()[name] is S.HELD
        assert world.vehicles[name].command == 0j
        assert "already" in done(world, "hold")

    def resume(name: str) -> None:
        assert world.states()[name] is S.HELD
        assert max(world.vehicles[name].renewals, default=0.0) < world.clock.now_s() - 9.0
        assert name in done(world, "resume")

    script = in_turn(
        *(
            step
            for name, state in states.items()
            for step in (
                (reached(world, name, state, for_s=0.5 if state in (S.LEG_1, S.LEG_2) else 0.0), partial(hold, name)),
                (after(world, 10.0), partial(resume, name)),
            )
        )
    )
    await world.run(meanwhile=script)
    settled_within(world)
    for name, state in states.items():
        changes = [change for _, at, change, _ in world.history if at == name]
        assert changes[changes.index(S.HELD) - 1] is state
        legs = world.executor.records[name].legs
        assert state is S.VERIFYING or 1 <= len(legs) <= 2  # those since it was located last


async def test_resumed_it_is_located_anew_and_never_flies_on_the_stale_leg() -> None:
    world = World(sigma_deg=0.05, attended=True)
    flown_before: list[float] = []

    def resume() -> None:
        world.vehicles["U1"].place += 7 - 5j  # a gust has moved it while it hovered
        flown_before.extend(world.vehicles["U1"].renewals)
        done(world, "resume")

    script = in_turn(
        (reached(world, "U1", S.LEG_1, for_s=3.0), lambda: done(world, "hold")), (after(world, 30.0), resume)
    )
    await world.run(meanwhile=script, until=world.on_its_way("U2"))
    stood_within(world, "U1", 1.0)
    states = [state for _, name, state, _ in world.history if name == "U1"]
    assert states[states.index(S.HELD) + 1] is S.LOCATING
    first_s = world.vehicles["U1"].renewals[len(flown_before)]
    located_s = [time_s for time_s, name, state, _ in world.history if name == "U1" and state is S.LEG_1][-1]
    assert first_s >= located_s


async def test_resumed_in_the_middle_of_its_stop_it_is_located_only_when_it_hovers() -> None:
    world = World(sigma_deg=0.02, attended=True)

    def located_well() -> None:
        place = world.executor.records["U1"].place
        assert place is not None
        assert abs(world.frame.to_site(place) - world.vehicles["U1"].place) < 0.15

    script = in_turn(
        (reached(world, "U1", S.LEG_1, for_s=4.0), lambda: done(world, "hold")),
        (lambda: True, lambda: done(world, "resume")),
        (reached(world, "U1", S.LOCATING), lambda: None),
        (reached(world, "U1", S.LEG_1), located_well),
    )
    await world.run(meanwhile=script, until=world.on_its_way("U2"))
    stood_within(world, "U1", 1.0)


async def test_blown_far_from_where_it_was_held_it_flies_only_when_the_operator_insists() -> None:
    world = World(sigma_deg=0.1, attended=True)

    def blown() -> None:
        world.vehicles["U1"].place += 30 + 0j
        done(world, "resume")

    def insist() -> None:
        assert "from where it was held" in world.executor.records["U1"].reason
        done(world, "resume")

    script = in_turn(
        (reached(world, "U1", S.LEG_1, for_s=2.0), lambda: done(world, "hold")),
        (after(world, 5.0), blown),
        (reached(world, "U1", S.LOCATING), lambda: None),
        (reached(world, "U1", S.HELD, for_s=2.0), insist),
    )
    await world.run(meanwhile=script, until=world.on_its_way("U2"))
    stood_within(world, "U1")


async def test_with_no_way_along_its_planned_guides_it_takes_another() -> None:
    world = World(sigma_deg=0.1, attended=True)
    record = world.executor.records["U2"]

    def spoil() -> None:
        legs = tuple(replace(leg, guide="L0") for leg in record.route.legs)  # two lines that meet in L0 itself
        record.route = replace(record.route, legs=legs)
        done(world, "resume")

    def insist() -> None:
        assert "falls on a transmitter" in record.reason
        done(world, "resume")

    script = in_turn(
        (reached(world, "U2", S.LEG_1, for_s=2.0), lambda: done(world, "hold")),
        (after(world, 5.0), spoil),
        (reached(world, "U2", S.LOCATING), lambda: None),
        (reached(world, "U2", S.HELD, for_s=2.0), insist),
    )
    await world.run(meanwhile=script, until=world.on_its_way("U3"))
    stood_within(world, "U2")


@pytest.mark.parametrize(("off_m", "flown"), [(0.5, False), (2.5, True)])
async def test_put_back_into_its_slot_by_its_pilot_it_is_only_verified_and_beside_it_flown(
    off_m: float, flown: bool
) -> None:
    world = World(sigma_deg=0.05, attended=True)

    def parked() -> None:
        world.vehicles["U1"].place = world.frame.to_site(world.executor.records["U1"].route.target + off_m * 1j)
        world.vehicles["U1"].guided = True
        done(world, "release U1")
        done(world, "resume")
        world.vehicles["U1"].renewals.clear()

    script = in_turn(
        (reached(world, "U1", S.LEG_1, for_s=2.0), world.vehicles["U1"].take_over), (after(world, 10.0), parked)
    )
    await world.run(meanwhile=script, until=world.on_its_way("U2"))
    stood_within(world, "U1", 1.0)
    assert bool(world.vehicles["U1"].renewals) is flown


async def test_put_beside_another_by_its_pilot_it_is_not_flown_at_all() -> None:
    """Every way of it begins too near the other: its pilot has to fly it clear first."""
    world = World(sigma_deg=0.05, attended=True)
    record, start = world.executor.records["U1"], world.vehicles["U1"].place

    def parked() -> None:
        world.vehicles["U1"].place = world.vehicles["U5"].place + 3
        world.vehicles["U1"].guided = True
        done(world, "release U1")
        done(world, "resume")
        world.vehicles["U1"].renewals.clear()

    def flown_clear() -> None:
        assert "m from U5, nearer than the separation" in record.reason
        assert not world.vehicles["U1"].renewals
        world.vehicles["U1"].take_over()
        world.vehicles["U1"].place = start + 8
        world.vehicles["U1"].guided = True

    script = in_turn(
        (reached(world, "U1", S.LEG_1, for_s=2.0), world.vehicles["U1"].take_over),
        (after(world, 10.0), parked),
        (reached(world, "U1", S.LOCATING), lambda: None),
        (reached(world, "U1", S.HELD, for_s=2.0), flown_clear),
        (reached(world, "U1", S.PILOT, for_s=2.0), lambda: done(world, "release U1")),
        (lambda: True, lambda: done(world, "resume")),
    )
    await world.run(meanwhile=script, until=world.on_its_way("U2"))
    stood_within(world, "U1")


async def test_one_that_is_found_with_its_pilot_when_its_node_is_replaced_is_waited_for_and_said_once() -> None:
    world = World(sigma_deg=0.1, attended=True)

    def replaced() -> None:
        assert world.executor.waiting
        world.vehicles["U1"].take_over()
        world.executor.regain_reach(["U1"])

    def said_once() -> None:
        assert world.executor.waiting
        assert len([said for said in world.said if "waiting for" in said and "release U1" in said]) == 1
        done(world, "abort")

    script = in_turn(
        (
            reached(world, "U1", S.LEG_1, for_s=2.0),
            lambda: world.executor.lose_reach("north", ["U1"], "killed for a test"),
        ),
        (reached(world, "U1", S.HELD, for_s=2.0), replaced),
        (reached(world, "U1", S.PILOT, for_s=2.0), said_once),
    )
    await world.run(meanwhile=script)


async def test_a_silent_sensor_holds_the_relay_and_the_operator_resumes_it_repaired() -> None:
    world = World(sigma_deg=0.1, attended=True)

    def repaired() -> None:
        assert world.executor.waiting
        assert any("waiting for the operator: bearing-relay control resume" in said for said in world.said)
        world.silenced.clear()
        done(world, "resume")

    script = in_turn(
        (reached(world, "U3", S.LEG_1, for_s=2.0), lambda: world.silenced.add("U3")),
        (reached(world, "U3", S.HELD, for_s=30.0), repaired),
    )
    await world.run(meanwhile=script, until=world.on_its_way("U4"))
    stood_within(world, "U3")


async def test_an_unattended_relay_ends_when_it_is_held() -> None:
    world = World()
    script = in_turn((reached(world, "U2", S.LEG_1, for_s=2.0), lambda: world.silenced.add("U2")))
    await world.run(limit_s=200.0, meanwhile=script)
    assert world.states()["U2"] is S.HELD
    assert not world.executor.formed
    assert refused(world, "resume") == "the relay has ended"


async def test_resumed_by_the_operator_an_unattended_relay_still_ends_when_it_is_held() -> None:
    world = World()
    script = in_turn(
        (reached(world, "U1", S.LEG_1, for_s=1.0), lambda: done(world, "hold")),
        (after(world, 5.0), lambda: done(world, "resume")),
        (reached(world, "U1", S.LEG_1, for_s=1.0), lambda: world.silenced.add("U1")),
    )
    await world.run(limit_s=200.0, meanwhile=script)
    assert world.states()["U1"] is S.HELD
    assert not world.executor.formed


async def test_a_placed_one_that_its_pilot_takes_holds_those_who_need_it_and_is_brought_back() -> None:
    world = World(sigma_deg=0.1, attended=True)  # the paper's chain: U1 guides U2

    def held() -> None:
        assert world.states()["U1"] is S.PILOT
        assert world.states()["U2"] is S.HELD
        assert world.vehicles["U2"].command == 0j

    def give_back() -> None:
        world.vehicles["U1"].place += 15 + 5j
        world.vehicles["U1"].guided = True
        done(world, "release U1")
        done(world, "resume")

    script = in_turn(
        (reached(world, "U2", S.LEG_1, for_s=2.0), world.vehicles["U1"].take_over),
        (after(world, 0.2), held),
        (after(world, 10.0), give_back),
        (reached(world, "U1", S.LEG_1), lambda: None),
    )
    await world.run(meanwhile=script)
    settled_within(world)
    placed = [name for _, name, state, _ in world.history if state is S.PLACED]
    assert placed == ["U1", "U1", *(f"U{k}" for k in range(2, 9))]  # it stands again before anybody relies on it


async def test_a_placed_one_nobody_needs_any_more_is_left_to_its_pilot_and_the_others_go_on() -> None:
    world = World(sigma_deg=0.1)
    script = in_turn((reached(world, "U5", S.LEG_1), world.vehicles["U2"].take_over))
    await world.run(meanwhile=script)
    states = world.states()
    assert states.pop("U2") is S.PILOT
    assert set(states.values()) == {S.PLACED}
    assert not any(state is S.HELD for _, _, state, _ in world.history)


async def test_a_placed_one_nobody_needs_any_more_is_brought_back_only_when_the_operator_says_so() -> None:
    world = World(sigma_deg=0.1, attended=True)
    taken = world.vehicles["U2"]

    def give_back() -> None:
        taken.place += 9 + 4j
        taken.guided = True
        done(world, "release U2")
        taken.renewals.clear()

    def resume() -> None:
        assert world.states()["U2"] is S.HELD
        assert not taken.renewals
        assert "U2" in done(world, "resume")

    script = in_turn(
        (reached(world, "U5", S.LEG_1), taken.take_over),
        (after(world, 2.0), give_back),
        (reached(world, "U6", S.LEG_1), resume),
    )
    await world.run(meanwhile=script)
    settled_within(world)


async def test_a_transmitter_needed_later_that_its_pilot_takes_holds_those_who_fly_now() -> None:
    world = waves()
    executor = world.executor
    taken: list[str] = []

    def needed_later() -> list[str]:
        return [name for name in executor.standing.places if executor.users(name) and name not in world.on_air]

    def take() -> None:
        taken.append(needed_later()[0])
        world.vehicles[taken[0]].take_over()

    def held() -> None:
        assert not flying(world)
        assert f"{taken[0]} was taken over" in (executor.held or "")
        done(world, "abort")

    script = in_turn((lambda: bool(flying(world) and needed_later()), take), (after(world, 0.2), held))
    await world.run(meanwhile=script)


async def test_a_transmitter_of_no_route_that_its_pilot_takes_holds_who_is_located_by_it() -> None:
    world = World(sigma_deg=0.1, attended=True)
    moved, start = world.vehicles["U2"], world.vehicles["U2"].place

    def give_back() -> None:
        moved.place = start + 3
        moved.guided = True
        done(world, "release U2")
        done(world, "resume")

    def take() -> None:
        assert "L1" in world.on_air
        assert not world.executor.users("L1")
        world.vehicles["L1"].take_over()

    def held() -> None:
        assert world.states()["U2"] is S.HELD
        assert "L1 was taken over" in world.executor.records["U2"].reason
        assert not world.on_air
        done(world, "abort")

    script = in_turn(
        (reached(world, "U2", S.LEG_1, for_s=1.0), moved.take_over),
        (after(world, 1.0), give_back),
        (reached(world, "U2", S.LOCATING, for_s=3.5), take),
        (after(world, 0.2), held),
    )
    await world.run(meanwhile=script)


async def test_a_transmitter_from_the_start_that_leaves_guided_flight_is_not_trusted() -> None:
    world = World(sigma_deg=0.1, attended=True)  # the paper's chain: L0 guides everybody
    moments = {"U1": S.LOCATING, "U2": S.LEG_1, "U3": S.LEG_2, "U4": S.VERIFYING}

    def held(name: str) -> None:
        assert world.states()[name] is S.HELD
        assert "L0 was taken over" in world.executor.records[name].reason
        assert not world.on_air
        assert "release L0" in refused(world, "resume")

    def give_back() -> None:
        world.objections["L0"] = "9.0 m from its place"
        world.vehicles["L0"].guided = True
        assert "9.0 m from its place" in refused(world, "release L0")
        world.objections.clear()
        assert "taken to stand at its place" in done(world, "release L0")
        done(world, "resume")

    script = in_turn(
        *(
            step
            for name, moment in moments.items()
            for step in (
                (reached(world, name, moment), world.vehicles["L0"].take_over),
                (after(world, 0.2), partial(held, name)),
                (after(world, 10.0), give_back),
            )
        )
    )
    await world.run(meanwhile=script)
    settled_within(world)
    assert {name for _, name, state, _ in world.history if state is S.HELD} == moments.keys()


async def test_without_a_transmitter_given_up_the_others_find_another_way() -> None:
    world = World(sigma_deg=0.1, attended=True)

    def without() -> None:
        message = done(world, "skip L0")
        assert "U3, U4, U5, U6, U7, U8" in message
        assert "land it" not in message
        done(world, "resume")

    script = in_turn(
        (reached(world, "U3", S.LEG_1, for_s=1.0), world.vehicles["L0"].take_over), (after(world, 1.0), without)
    )
    await world.run(meanwhile=script)
    settled_within(world, 3.0)
    for number in range(1, 9):
        assert ("L0" in world.executor.records[f"U{number}"].route.transmitters) is (number < 3)


async def test_a_transmitter_given_up_stays_given_up_and_when_its_pilot_takes_it_again_nobody_holds() -> None:
    world = World(sigma_deg=0.1, attended=True)
    given_up = world.vehicles["L0"]

    def without() -> None:
        done(world, "skip L0")
        given_up.guided = True
        assert "stays given up" in done(world, "release L0")
        assert "L0" not in world.executor.standing.places
        done(world, "resume")

    def take_again() -> None:
        assert "U4" in world.executor.users("L0")
        given_up.take_over()

    script = in_turn(
        (reached(world, "U3", S.LEG_1, for_s=1.0), given_up.take_over),
        (after(world, 1.0), without),
        (reached(world, "U3", S.LEG_1), take_again),
    )
    await world.run(meanwhile=script, until=world.on_its_way("U4"))
    stood_within(world, "U3", 3.0)


async def test_a_skipped_receiver_fails_and_the_others_form_without_it() -> None:
    world = World(sigma_deg=0.1)

    def skip() -> None:
        message = done(world, "skip U3")
        assert "it hovers: land it from another station" in message
        assert "U4" in message
        assert world.states()["U3"] is S.FAILED
        assert world.vehicles["U3"].command == 0j
        assert "given up already" in refused(world, "skip U3")
        assert "nothing to give up" in refused(world, "skip U1")

    script = in_turn((reached(world, "U3", S.LEG_1, for_s=2.0), skip))
    await world.run(meanwhile=script)
    states = world.states()
    assert states.pop("U3") is S.FAILED
    assert set(states.values()) == {S.PLACED}
    errors_m = world.errors_m()
    assert max(errors_m[name] for name in states) < 3.0
    assert not world.executor.formed


async def test_whoever_has_no_way_without_the_one_given_up_fails_with_the_reason() -> None:
    """Of three transmitters one is given up and one is its pilot's for good: nobody can be located any more."""
    world = World(sigma_deg=0.1, attended=True)

    def give_up() -> None:
        done(world, "skip L1")
        done(world, "skip U1")
        done(world, "resume")

    def take_all() -> None:
        for name in ("L1", "U1"):
            world.vehicles[name].take_over()

    script = in_turn((reached(world, "U2", S.LEG_1, for_s=1.0), take_all), (after(world, 1.0), give_up))
    await world.run(limit_s=200.0, meanwhile=script)
    assert set(world.states().values()) == {S.FAILED}
    reasons = {record.reason for record in world.executor.records.values()}
    assert "given up by the operator" in reasons
    assert any("U1 was given up" in reason and "two transmitters" in reason for reason in reasons)


async def test_the_last_one_taken_while_it_waits_holds_the_relay_though_nobody_needs_it() -> None:
    world = World(attended=True)

    def held() -> None:
        assert not world.executor.users("U8")
        assert world.states()["U8"] is S.PILOT
        assert world.states()["U1"] is S.HELD
        done(world, "abort")

    script = in_turn(
        (reached(world, "U1", S.LEG_1, for_s=1.0), world.vehicles["U8"].take_over), (after(world, 0.2), held)
    )
    await world.run(meanwhile=script)


async def test_a_relay_in_which_everybody_is_given_up_ends() -> None:
    world = World(attended=True)

    def give_up() -> None:
        for name in world.states():
            done(world, f"skip {name}")

    script = in_turn((lambda: True, lambda: done(world, "hold")), (lambda: world.executor.waiting, give_up))
    await world.run(limit_s=20.0, meanwhile=script)
    assert set(world.states().values()) == {S.FAILED}


async def test_one_taken_while_it_waits_holds_the_relay_too_and_flies_in_its_turn() -> None:
    world = World(sigma_deg=0.1, attended=True)

    def give_back() -> None:
        assert world.states()["U5"] is S.PILOT
        assert world.states()["U1"] is S.HELD
        world.vehicles["U5"].place += -8 + 14j
        world.vehicles["U5"].guided = True
        done(world, "release U5")
        done(world, "resume")

    script = in_turn(
        (reached(world, "U1", S.LEG_1, for_s=1.0), world.vehicles["U5"].take_over), (after(world, 5.0), give_back)
    )
    await world.run(meanwhile=script)
    settled_within(world)
    order = [name for _, name, state, _ in world.history if state is S.PLACED]
    assert order == [f"U{k}" for k in range(1, 9)]


async def test_abort_while_held_ends_the_relay() -> None:
    world = World(sigma_deg=0.1, attended=True)

    def abort() -> None:
        done(world, "abort")
        assert refused(world, "resume") == "the relay has ended"

    script = in_turn(
        (reached(world, "U1", S.LEG_1), lambda: done(world, "hold")), (reached(world, "U1", S.HELD, for_s=20.0), abort)
    )
    await world.run(limit_s=100.0, meanwhile=script)
    assert world.states()["U1"] is S.HELD
    assert not world.executor.formed


async def test_abort_in_flight_stops_at_once() -> None:
    world = World(sigma_deg=0.1, attended=True)

    def abort() -> None:
        assert world.vehicles["U1"].command != 0j
        done(world, "abort")
        assert world.vehicles["U1"].command == 0j
        assert world.states()["U1"] is S.HELD

    await world.run(limit_s=100.0, meanwhile=in_turn((reached(world, "U1", S.LEG_1, for_s=2.0), abort)))
    assert not world.executor.formed


async def test_a_waiting_relay_that_is_cancelled_ends() -> None:
    world = World(attended=True)
    relay = asyncio.create_task(world.executor.run())
    await world.clock.advance(PERIOD_S)
    done(world, "hold")
    await world.clock.advance(60.0)
    assert not relay.done()
    relay.cancel()
    with pytest.raises(asyncio.CancelledError):
        await relay
    assert refused(world, "resume") == "the relay has ended"


async def test_a_take_over_of_this_instant_counts_and_the_first_reason_to_hold_stays() -> None:
    world = World(attended=True)
    world.vehicles["U1"].take_over()
    assert "already: U1 was taken over" in done(world, "hold")
    assert "U1 was taken over" in (world.executor.held or "")
    assert "release U1" in refused(world, "resume")
    assert len([said for said in world.said if said.startswith("the relay holds")]) == 1


async def test_words_that_make_no_sense_change_nothing_and_say_what_would() -> None:
    world = World(attended=True)
    assert refused(world, "resume") == "nothing is held"
    assert "U9" in refused(world, "skip U9")
    assert "U1" in refused(world, "release nobody")
    assert "the service's already" in refused(world, "release U1")
    assert "nothing to give up" in refused(world, "skip L0")
    assert "names one vehicle" in refused(world, "skip")
    assert "names no vehicle" in refused(world, "abort U1")
    assert set(world.states().values()) == {S.WAITING}
    assert world.executor.held is None
    assert world.vehicles["U1"].state is StreamState.SILENT
    assert "nobody" in done(world, "hold")
    assert "nobody" in done(world, "resume")
    assert world.executor.held is None
