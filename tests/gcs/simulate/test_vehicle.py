"""A simulated vehicle flies what the embedded copter's process flies, and no longer than its lease lasts."""

from __future__ import annotations

import math

import pytest

from drivers.mavlink.setpoint_messages import velocity_setpoint
from drivers.mavlink.setpoints import ZERO_REPEATED_S, StreamLimits, StreamState
from drivers.simulation.autopilot import Autopilot
from drivers.simulation.geodesy import GeoPoint
from drivers.simulation.modes import Mode
from drivers.simulation.parameters import Parameters
from drivers.simulation.weather import CALM, SimulatedWeather, copter_parameters
from gcs.simulate.vehicle import SimulatedVehicle
from tests.fakes import ManualClock

LIMITS = StreamLimits(lease_s=0.5)
WINDY = SimulatedWeather(wind_mps=5.0, wind_from_rad=math.radians(45.0), gusts_mps=2.0)


def a_vehicle(clock: ManualClock, weather: SimulatedWeather = CALM, seed: int = 1) -> SimulatedVehicle:
    return SimulatedVehicle(100 + 50j, 20.0, LIMITS, clock, weather, seed)


def fly(vehicle: SimulatedVehicle, clock: ManualClock, velocity: complex, duration_s: float) -> None:
    for _ in range(round(duration_s / 0.1)):
        vehicle.renew(velocity)
        clock.jump(0.1)
    vehicle.advance()


@pytest.mark.parametrize("weather", [CALM, WINDY])
def test_it_flies_as_the_copter_that_is_told_by_mavlink(weather: SimulatedWeather) -> None:
    """The same setpoints, as messages to the embedded autopilot: the same motion."""
    clock = ManualClock()
    vehicle = a_vehicle(clock, weather, seed=3)
    parameters = Parameters()
    for name, value in copter_parameters(weather).items():
        parameters.set(name, value)
    autopilot = Autopilot("U1", GeoPoint(-35.0, 149.0, 584.0), parameters, seed=3)
    port, flight = autopilot.open_port(), autopilot.flight
    flight.enter(Mode.GUIDED)
    flight.arm()
    flight.take_off(20.0)
    began_s = vehicle._flight.time_s
    flight.advance(began_s)
    started_s = clock.now_s()
    for velocity in (3 + 1j, -2 + 2j, 0j):
        for _ in range(30):
            vehicle.renew(velocity)
            now_s = began_s + clock.now_s() - started_s
            autopilot.receive(port, velocity_setpoint(1, velocity, 0.0), now_s)
            clock.jump(0.1)
    vehicle.advance()
    autopilot.advance(began_s + clock.now_s() - started_s)
    dynamics = autopilot.flight.dynamics
    flown = complex(dynamics.north.position_m, dynamics.east.position_m)
    assert abs(flown) > 3.0
    assert vehicle.place - (100 + 50j) == pytest.approx(flown, abs=1e-6)
    assert vehicle.velocity == pytest.approx(complex(dynamics.north.velocity_mps, dynamics.east.velocity_mps), abs=1e-6)


def test_without_a_renewal_it_stops_when_the_lease_ends_however_late_one_looks() -> None:
    clock = ManualClock()
    late, watched = a_vehicle(clock), a_vehicle(clock)
    for vehicle in (late, watched):
        vehicle.renew(3 + 0j)
    for _ in range(100):
        clock.jump(0.1)
        watched.advance()
    late.advance()
    assert late.place == pytest.approx(watched.place)
    assert 0.3 < (late.place - (100 + 50j)).real < 2.5
    assert late.command == 0j
    assert abs(late.velocity) < 0.02


def test_who_stands_still_takes_no_steps_and_flies_on_from_there_as_one_who_took_them_all() -> None:
    clock = ManualClock()
    watched, unseen = a_vehicle(clock), a_vehicle(clock)
    for vehicle in (watched, unseen):
        vehicle.renew(4 + 1j)
    for _ in range(600):
        clock.jump(0.1)
        watched.advance()
    unseen.advance()
    assert unseen._flight.time_s - watched._flight.time_s > 30.0
    assert watched.place == pytest.approx(unseen.place, abs=1e-3)
    for velocity in (-3 + 1j, 2j, 0j):
        for _ in range(20):
            for vehicle in (watched, unseen):
                vehicle.renew(velocity)
            clock.jump(0.1)
    for vehicle in (watched, unseen):
        vehicle.advance()
    assert abs(watched.place - (100 + 50j)) > 3.0
    assert watched.place == pytest.approx(unseen.place, abs=0.01)
    assert watched.velocity == pytest.approx(unseen.velocity, abs=0.01)


def test_it_is_silent_some_time_after_it_was_stopped() -> None:
    clock = ManualClock()
    vehicle = a_vehicle(clock)
    assert vehicle.state is StreamState.SILENT
    fly(vehicle, clock, 2j, 1.0)
    assert vehicle.state is StreamState.LEASED
    vehicle.stop()
    assert vehicle.state is StreamState.STOPPING
    clock.jump(ZERO_REPEATED_S)
    vehicle.advance()
    assert vehicle.state is StreamState.SILENT


def test_a_pilot_keeps_it_until_he_gives_it_back_and_the_operator_releases_it() -> None:
    clock = ManualClock()
    vehicle = a_vehicle(clock)
    fly(vehicle, clock, 3 + 0j, 3.0)
    vehicle.take_over()
    for _ in range(60):
        vehicle.renew(3 + 0j)
        vehicle.stop()
        clock.jump(0.1)
    assert vehicle.state is StreamState.PILOT
    vehicle.advance()
    assert abs(vehicle.velocity) < 0.05
    assert vehicle.release() is not None
    vehicle.give_back()
    assert vehicle.state is StreamState.PILOT
    assert vehicle.release() is None
    assert vehicle.state is StreamState.SILENT


def test_gusts_move_a_hovering_vehicle_each_seed_in_its_own_way() -> None:
    clock = ManualClock()
    vehicles = [a_vehicle(clock, WINDY, seed) for seed in (1, 1, 2)]
    clock.jump(20.0)
    for vehicle in vehicles:
        vehicle.advance()
    same, twin, other = (vehicle.place for vehicle in vehicles)
    assert same == twin
    assert abs(same - other) > 0.01
    assert 0.001 < abs(same - (100 + 50j)) < 3.0


def test_it_is_at_its_height_and_its_place_when_made() -> None:
    vehicle = a_vehicle(ManualClock())
    assert vehicle.height_m == pytest.approx(20.0, abs=0.5)
    assert vehicle.place == pytest.approx(100 + 50j, abs=1e-6)
    vehicle.place = 7 - 3j
    assert vehicle.place == pytest.approx(7 - 3j)
