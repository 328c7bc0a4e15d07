"""The relay executor in virtual time: it forms up from bearings alone, and every fault ends in zero velocity."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

import msgspec
import pytest

from drivers.mavlink.setpoints import StreamState
from gcs.relay.states import ReceiverState
from planner.methods import METHODS
from tests.gcs.relay.world import LEASE_S, PERIOD_S, World

PLACED, HELD, WAITING, PILOT = (
    ReceiverState.PLACED,
    ReceiverState.HELD,
    ReceiverState.WAITING,
    ReceiverState.PILOT,
)


@pytest.mark.parametrize("seed", [1, 2])
async def test_the_paper_s_eight_form_up_one_after_the_other_from_bearings_alone(seed: int) -> None:
    """The executor is handed leases, bearings and nothing else: there is no position it could have used."""
    world = World(sigma_deg=0.1, seed=seed)
    most = 0

    def look(_: float) -> None:
        nonlocal most
        most = max(most, len(world.on_air))
        in_flight = [name for name, state in world.states().items() if state not in (PLACED, WAITING)]
        assert len(in_flight) <= 1

    await world.run(meanwhile=look)
    assert set(world.states().values()) == {PLACED}
    assert world.executor.formed
    assert max(world.errors_m().values()) < 1.0
    assert most == 2
    assert not world.on_air  # the relay leaves nobody transmitting
    order = [name for _, name, state, _ in world.history if state is PLACED]
    assert order == [f"U{k}" for k in range(1, 9)]
    assert world.emission.transmitter_s() == pytest.approx(2 * (world.clock.now_s() - 100.0), rel=0.05)


@pytest.mark.parametrize(("uavs", "objective"), [(8, "length"), (8, "balanced"), (20, "balanced")])
async def test_joint_plans_form_up_and_their_waves_fly_together(uavs: int, objective: str) -> None:
    problem = replace(World(uavs=uavs).playbook.problem(), objective=objective)
    world = World(uavs=uavs, plan=METHODS["joint"](problem))
    together = 0

    def look(_: float) -> None:
        nonlocal together
        flying = [name for name, state in world.states().items() if state not in (PLACED, WAITING)]
        together = max(together, len(flying))
        assert len({world.plan.route_of(name).wave for name in flying}) <= 1

    await world.run(meanwhile=look)
    assert world.executor.formed
    assert max(world.errors_m().values()) < 1.0
    waves = [route.wave for route in world.plan.routes]
    assert together == max(waves.count(wave) for wave in waves)
    assert not world.on_air


async def test_a_receiver_already_in_its_slot_is_only_verified() -> None:
    world = World()
    record = world.executor.records["U1"]
    record.route = replace(record.route, start=record.route.target, legs=())
    world.vehicles["U1"].place = world.frame.to_site(record.route.target)
    await world.run(until=world.on_its_way("U2"))
    assert record.state is PLACED
    assert not world.vehicles["U1"].renewals


async def test_legs_are_replanned_from_where_the_receiver_really_is() -> None:
    world = World(sigma_deg=0.05)
    world.vehicles["U1"].place += 6 - 4j  # it drifted while it waited
    await world.run(until=world.on_its_way("U2"))
    assert world.states()["U1"] is PLACED
    assert world.errors_m()["U1"] < 1.0


async def test_a_receiver_far_from_its_start_is_not_flown() -> None:
    world = World(sigma_deg=0.05)
    world.vehicles["U1"].place += 40 + 0j
    await world.run()
    record = world.executor.records["U1"]
    assert record.state is HELD
    assert "from its start" in record.reason
    assert not world.vehicles["U1"].renewals


async def test_a_silent_sensor_means_zero_velocity_within_a_second_and_held_in_the_end() -> None:
    world = World()
    silent_at = 0.0

    def silence(now_s: float) -> None:
        nonlocal silent_at
        if not silent_at and world.states()["U1"] is ReceiverState.LEG_1 and now_s > 6.0:
            silent_at = world.clock.now_s()
            world.silenced.add("U1")
        if silent_at and world.clock.now_s() > silent_at + 1.0:
            assert world.vehicles["U1"].command == 0j

    await world.run(meanwhile=silence)
    record = world.executor.records["U1"]
    assert record.state is HELD
    assert "no bearing report from its sensor" in record.reason
    assert max(world.vehicles["U1"].renewals) <= silent_at
    assert [state for name, state in world.states().items() if name != "U1"] == [WAITING] * 7


async def test_a_gap_is_survived() -> None:
    world = World()
    world_gap = (8.0, 11.0)

    def gap(now_s: float) -> None:
        (world.silenced.add if world_gap[0] < now_s < world_gap[1] else world.silenced.discard)("U1")

    await world.run(meanwhile=gap, until=world.on_its_way("U2"))
    assert world.states()["U1"] is PLACED
    assert world.errors_m()["U1"] < 1.0
    reasons = [reason for _, name, _, reason in world.history if name == "U1"]
    assert any("zero velocity" in reason for reason in reasons)


async def test_a_transmitter_that_falls_silent_stops_the_receiver_and_is_named() -> None:
    world = World()

    def mute(now_s: float) -> None:
        if now_s > 8.0:
            world.on_air.discard("L0")

    await world.run(meanwhile=mute)
    record = world.executor.records["U1"]
    assert record.state is HELD
    assert "does not hear L0" in record.reason


async def held_because(name: str, problem: str) -> str:
    """Object to a vehicle while U1 flies, which stops at once and is held; return its reason."""
    world = World()

    def object_to(now_s: float) -> None:
        if now_s > 8.0:
            world.objections[name] = problem

    await world.run(meanwhile=object_to)
    record = world.executor.records["U1"]
    assert record.state is HELD
    assert world.vehicles["U1"].command == 0j
    assert max(world.vehicles["U1"].renewals) <= 100.0 + 8.0 + 2 * PERIOD_S
    return record.reason


async def test_safety_s_objection_stops_and_holds() -> None:
    assert "only 2.0 m from U5" in await held_because("U1", "only 2.0 m from U5")


async def test_an_objection_is_announced_once_whatever_its_figures() -> None:
    world = World()

    def come_nearer(now_s: float) -> None:
        if now_s > 8.0:
            world.objections["U1"] = f"only {max(2.0, 12.0 - now_s):.2f} m from {'U5' if now_s < 10.0 else 'U6'}"

    await world.run(meanwhile=come_nearer)
    said = [reason for _, name, _, reason in world.history if name == "U1" and reason.endswith(": zero velocity")]
    assert [reason.split()[4] for reason in said] == ["U5:", "U6:"]


async def test_a_transmitter_that_tells_of_being_off_its_place_stops_who_flies_by_it() -> None:
    reason = await held_because("L0", "it is 4.0 m from its place")
    assert "its transmitter L0: it is 4.0 m from its place" in reason


async def test_a_pilot_ends_it_for_everyone() -> None:
    world = World()

    def take_over(now_s: float) -> None:
        if now_s > 8.0:
            world.vehicles["U1"].state = StreamState.PILOT  # its renew() fails the test from here on

    await world.run(meanwhile=take_over)
    record = world.executor.records["U1"]
    assert record.state is PILOT
    assert "pilot" in record.reason
    assert [state for name, state in world.states().items() if name != "U1"] == [WAITING] * 7


async def test_the_operator_s_abort_stops_at_once() -> None:
    world = World()

    def abort(now_s: float) -> None:
        if 8.0 < now_s < 8.0 + PERIOD_S:
            world.executor.abort("stopped by the operator")
            assert world.vehicles["U1"].command == 0j

    await world.run(meanwhile=abort)
    assert world.executor.records["U1"].reason == "stopped by the operator"
    assert not world.executor.formed


async def test_whatever_ends_the_relay_stops_the_vehicle_in_flight() -> None:
    world = World()
    relay = asyncio.create_task(world.executor.run())
    while not world.vehicles["U1"].renewals:
        world._measure()
        await world.clock.advance(PERIOD_S)
    assert world.vehicles["U1"].command != 0j
    relay.cancel()
    with pytest.raises(asyncio.CancelledError):
        await relay
    assert world.vehicles["U1"].command == 0j
    assert not world.on_air


async def test_a_stuck_sensor_is_not_flown_on() -> None:
    """It repeats one report: later ones are out of order, so there is no fresh bearing and no lease."""
    world = World()
    stuck: list[bytes] = []

    def stick(name: str, payload: bytes) -> bytes:
        if name == "U1" and world.clock.now_s() > 108.0:
            stuck.append(payload)
            return stuck[0]
        return payload

    world.tamper = stick
    await world.run()
    assert world.executor.records["U1"].state is HELD
    counters = world.feed.counters
    assert counters.duplicate + counters.out_of_order + counters.stale > 10


async def test_a_sensor_that_turns_by_45_degrees_is_not_flown_on() -> None:
    world = World()
    first_wrong_s = 0.0

    def turn(name: str, payload: bytes) -> bytes:
        nonlocal first_wrong_s
        if name != "U1" or world.clock.now_s() < 108.0:
            return payload
        first_wrong_s = first_wrong_s or world.clock.now_s()
        report = msgspec.json.decode(payload)
        for bearing in report["bearings"]:
            bearing["azimuth_rad"] = (bearing["azimuth_rad"] + math.radians(45.0)) % math.tau
        return msgspec.json.encode(report)

    world.tamper = turn
    await world.run()
    record = world.executor.records["U1"]
    assert record.state is HELD
    assert "contradict" in record.reason
    assert max(world.vehicles["U1"].renewals) <= first_wrong_s


async def test_five_percent_of_wild_bearings_do_not_keep_it_from_forming() -> None:
    world = World(sigma_deg=0.1, seed=3)

    def sometimes_wild(name: str, payload: bytes) -> bytes:
        noise = world.sensors[name].noise
        if noise.random() >= 0.05:
            return payload
        report = msgspec.json.decode(payload)
        for bearing in report["bearings"]:
            bearing["azimuth_rad"] = noise.uniform(0.0, math.tau)
        return msgspec.json.encode(report)

    world.tamper = sometimes_wild
    await world.run()
    assert world.executor.formed
    assert max(world.errors_m().values()) < 1.0


async def test_no_setpoint_outlives_its_lease() -> None:
    """Between any two renewals further apart than the lease, the commanded velocity was zero."""
    world = World()
    seen: list[tuple[float, complex]] = []

    def watch(now_s: float) -> None:
        (world.silenced.add if int(now_s) % 7 == 3 else world.silenced.discard)("U1")
        seen.append((world.clock.now_s(), world.vehicles["U1"].command))

    await world.run(meanwhile=watch, until=world.on_its_way("U2"))
    renewals = world.vehicles["U1"].renewals
    assert len(renewals) > 50
    for time_s, command in seen:
        last = max((at for at in renewals if at <= time_s), default=None)
        if last is None or time_s > last + LEASE_S + 2 * PERIOD_S:
            assert command == 0j
