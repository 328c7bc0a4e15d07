"""Bearings from the nose, no north anywhere: every receiver points where it likes, and the relay forms up."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest

from drivers.bus.messages import BearingReport, decode, encode
from gcs.commands.options import changed
from gcs.errors import ServiceError
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import ReceiverState
from gcs.simulate.bus import LocalBus
from gcs.simulate.vehicle import SimulatedVehicle
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from gcs.simulate.world import RelayWorld
from gcs.simulated_vehicles import weather_of
from planner.plan import RelayPlan
from planner.relay_accuracy import relay_accuracy

PLACED, HELD, LEG_1 = ReceiverState.PLACED, ReceiverState.HELD, ReceiverState.LEG_1
LIMIT_S = 600.0


class Turned(SimulatedVehicle):
    """A copter whose nose points somewhere."""

    turned_rad = 0.0

    @property
    def heading_rad(self) -> float:
        return super().heading_rad + self.turned_rad


class NoseWorld(RelayWorld):
    """Noses at random, and starts that are off by what the playbook says of them; `meanwhile` sees every moment."""

    vehicles: dict[str, Turned]

    def __init__(self, playbook: Playbook, plan: RelayPlan, seed: int, *, attended: bool = False) -> None:
        self.draws = random.Random(seed)
        self.stood: dict[str, complex] = {}
        self.meanwhile: Callable[[], None] = lambda: None
        super().__init__(playbook, plan, VirtualClock(), LocalBus(), seed=seed, attended=attended)

    def make_vehicle(self, name: str, home: complex) -> Turned:
        start_sigma_m = self.playbook.planner.start_sigma_m if name in self.playbook.receivers else 0.0
        off = complex(self.draws.gauss(0.0, start_sigma_m), self.draws.gauss(0.0, start_sigma_m))
        weather = weather_of(self.playbook)
        vehicle = Turned(home + off, self.playbook.flight.altitude_m, self.limits, self.clock, weather, 0)
        vehicle.turned_rad = self.draws.uniform(-math.pi, math.pi)
        return vehicle

    def measure(self) -> None:
        self.meanwhile()
        super().measure()

    def announced(self, record: ReceiverRecord) -> None:
        if record.state is PLACED:
            self.stood[record.name] = self.frame.from_site(self.places()[record.name])

    @property
    def states(self) -> dict[str, ReceiverState]:
        return {name: record.state for name, record in self.executor.records.items()}


@cache
def waves(sigma_deg: float, reference: str = "body") -> tuple[Playbook, RelayPlan]:
    playbook = load_playbook(Path("sitl_configs/waves_8.yaml"))
    playbook = changed(changed(playbook, "sensor", sigma_deg=sigma_deg, reference=reference), "flight", speed_mps=3.0)
    return playbook, playbook.plan()


def flown(
    sigma_deg: float,
    seed: int,
    *,
    start_sigma_m: float = 1.0,
    prepare: Callable[[NoseWorld], None] = lambda _: None,
    attended: bool = False,
    limit_s: float = LIMIT_S,
) -> NoseWorld:
    """Return the world after its relay."""

    async def fly() -> NoseWorld:
        playbook, plan = waves(sigma_deg)
        world = NoseWorld(changed(playbook, "planner", start_sigma_m=start_sigma_m), plan, seed, attended=attended)
        prepare(world)
        await world.run(limit_s)
        return world

    return run_virtually(fly())


def squared_sigmas(off: complex, covariance: np.ndarray) -> float:
    """Return the squared Mahalanobis distance: 2 on average where the covariance is that of the error."""
    vector = np.array([off.real, off.imag])
    return float(vector @ np.linalg.solve(covariance, vector))


@pytest.mark.parametrize(("sigma_deg", "seeds"), [(0.1, (1, 2, 3)), (0.5, (1, 2, 3))])
def test_the_relay_forms_as_accurately_as_predicted_and_knows_how_accurately(sigma_deg: float, seeds: tuple) -> None:
    """The prediction takes no credit for what is heard along a leg; nobody may do worse, and by chance nobody does."""
    playbook, plan = waves(sigma_deg)
    predicted = relay_accuracy(playbook.problem(), plan.routes)
    against_plan, against_belief = [], []
    for seed in seeds:
        world = flown(sigma_deg, seed)
        assert set(world.states.values()) == {PLACED}
        for name, record in world.executor.records.items():
            stands, believed = world.stood[name], world.executor.standing.places[name]
            assert record.covariance is not None
            against_plan.append(squared_sigmas(stands - record.route.target, predicted[name].slot))
            against_belief.append(squared_sigmas(stands - believed, record.covariance))
    assert 0.1 < np.mean(against_plan) < 2.0
    assert 0.2 < np.mean(against_belief) < 2.0


def test_who_takes_bearings_from_the_nose_for_bearings_from_north_flies_nobody() -> None:
    """The same sensors, said to know north: nobody is where such bearings put it."""

    def north_pretended(name: str, payload: bytes) -> bytes:
        return encode(msgspec.structs.replace(decode(payload, BearingReport), reference="true_north"))

    async def fly() -> NoseWorld:
        playbook, plan = waves(0.1, "true_north")
        world = NoseWorld(playbook, plan, 1)
        body, _ = waves(0.1)
        for name, sensor in world.sensors.items():
            sensor.model = body.sensor.model_of(name)
        world.tamper = north_pretended
        await world.run(LIMIT_S)
        return world

    world = run_virtually(fly())
    assert PLACED not in world.states.values()
    assert all(vehicle.command == 0j for vehicle in world.vehicles.values())


def test_a_plan_that_counts_on_north_is_not_flown_by_the_nose() -> None:
    async def make() -> None:
        playbook, plan = waves(0.1)
        world = NoseWorld(playbook, plan, 1)
        north = replace(playbook.problem(), heading_referenced=True)
        type(world.executor)(
            world.executor.records,
            {},
            leases=world.vehicles,
            feed=world.feed,
            emission=world.emission,
            frame=world.frame,
            clock=world.clock,
            settings=world.settings,
            objection=lambda _: None,
            announce=world.announced,
            problem=north,
        )

    with pytest.raises(ServiceError, match="true_north"):
        run_virtually(make())


def test_starts_said_to_be_exact_are_taken_to_be_as_good_as_any_place_is() -> None:
    assert set(flown(0.1, 1, start_sigma_m=0.0).states.values()) == {PLACED}


def test_noses_that_turn_in_flight_are_found_again() -> None:
    def turning(world: NoseWorld) -> None:
        def turn() -> None:
            if world.clock.now_s() % 15.0 < 0.05:
                for vehicle in world.vehicles.values():
                    vehicle.turned_rad += math.radians(40.0)

        world.meanwhile = turn

    world = flown(0.1, 1, prepare=turning)
    assert set(world.states.values()) == {PLACED}
    assert max(world.errors_m().values()) < 1.5


def test_noses_that_yaw_in_the_wind_do_no_harm() -> None:
    """A degree, back and forth within seconds: ten times the noise of a bearing."""

    def yawing(world: NoseWorld) -> None:
        pointed = {name: vehicle.turned_rad for name, vehicle in world.vehicles.items()}

        def yaw() -> None:
            for number, (name, vehicle) in enumerate(world.vehicles.items()):
                vehicle.turned_rad = pointed[name] + math.radians(1.0) * math.sin(2.0 * world.clock.now_s() + number)

        world.meanwhile = yaw

    world = flown(0.1, 1, prepare=yawing)
    assert set(world.states.values()) == {PLACED}
    assert max(world.errors_m().values()) < 1.5


def test_reflections_are_told_from_the_nose() -> None:
    """One bearing in twenty is thrown by 10, 45 or 180 degrees; where the nose points must not go along."""

    def reflecting(world: NoseWorld) -> None:
        for sensor in world.sensors.values():
            faults = msgspec.structs.replace(sensor.model.faults, outlier_share=0.05)
            sensor.model = replace(sensor.model, faults=faults)

    world = flown(0.5, 12, prepare=reflecting)
    assert set(world.states.values()) == {PLACED}
    assert max(world.errors_m().values()) < 2.5


def test_a_relay_held_in_mid_leg_goes_on_from_where_its_motion_ended() -> None:
    """Two transmitters give a circle and no place: where the filter saw them stop is what they are located with."""

    def holding(world: NoseWorld) -> None:
        held_s: list[float] = []

        def hold() -> None:
            now_s = world.clock.now_s()
            if not held_s and now_s > 6.0:
                assert world.executor.hold("to see", wait=True)
                held_s.append(now_s)
            elif held_s and world.executor.held is not None and now_s > held_s[0] + 10.0:
                assert world.executor.resume() == ["U2", "U3", "U7"]

        world.meanwhile = hold

    world = flown(0.1, 1, prepare=holding)
    assert set(world.states.values()) == {PLACED}
    assert max(world.errors_m().values()) < 2.5


def test_one_that_a_pilot_has_moved_is_not_located_by_two() -> None:
    """It may be anywhere on the circle that two transmitters give."""

    def taking(world: NoseWorld) -> None:
        taken_s: list[float] = []

        def take() -> None:
            now_s = world.clock.now_s()
            if not taken_s and world.states["U2"] is LEG_1 and now_s > 5.0:
                world.vehicles["U2"].take_over()
                taken_s.append(now_s)
            elif taken_s and world.states["U2"] is ReceiverState.PILOT and now_s > taken_s[0] + 5.0:
                world.vehicles["U2"].place += 8.0 - 5.0j
                world.vehicles["U2"].give_back()
                assert world.vehicles["U2"].release() is None
            elif world.states["U2"] is HELD and world.executor.held is not None and len(taken_s) == 1:
                taken_s.append(now_s)
                world.executor.resume()
            elif len(taken_s) > 1 and world.executor.held is not None:
                world.executor.abort("seen enough")

        world.meanwhile = take

    world = flown(0.1, 1, prepare=taking, attended=True)
    record = world.executor.records["U2"]
    assert record.strayed
    assert any("three transmitters while the heading is unknown" in said for said in world.said)
