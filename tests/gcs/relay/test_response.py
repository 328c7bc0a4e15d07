"""The response to commands is that of the embedded copter, which was fitted to an ArduCopter."""

from __future__ import annotations

import cmath

import pytest

from drivers.simulation.flight import Flight, Order
from drivers.simulation.goals import Climb, Goal, Velocity
from drivers.simulation.modes import Mode
from drivers.simulation.parameters import Parameters
from gcs.relay.response import Agility, Response


def copter() -> Flight:
    flight = Flight(Parameters(), lambda *_: None)
    flight.enter(Mode.GUIDED)
    flight.arm()
    flight.take_off(10.0)
    flight.advance(20.0)
    return flight


def command(flight: Flight, velocity: complex) -> None:
    flight.obey(Order(Goal(Velocity(velocity.real, velocity.imag, flight.horizontal), Climb(0.0, flight.vertical))))


@pytest.mark.parametrize("speed_mps", [0.5, 1.0, 3.0, 5.0, 8.0])
def test_a_straight_flight_and_its_stop_are_foretold(speed_mps: float) -> None:
    flight, response = copter(), Response(Agility(), 20.0)
    course = cmath.rect(1.0, 0.7)
    for start_s, velocity in ((20.0, speed_mps * course), (28.0, 0j)):
        command(flight, velocity)
        response.commanded(start_s, velocity)
        for step in range(1, 41):
            now_s = start_s + step * 0.2
            flight.advance(now_s)
            response.advance(now_s)
            north, east = flight.dynamics.north, flight.dynamics.east
            seen = response.place + response.overshoot
            assert abs(complex(north.velocity_mps, east.velocity_mps) - response.velocity) < 0.15 * speed_mps
            assert abs(complex(north.position_m, east.position_m) - seen) < 0.13 * speed_mps
    assert abs(complex(flight.dynamics.north.position_m, flight.dynamics.east.position_m) - response.place) < (
        0.05 * speed_mps
    )


def test_looking_ahead_changes_nothing() -> None:
    response = Response(Agility(), 0.0)
    response.commanded(0.0, 3.0 + 0j)
    response.advance(1.0)
    before = (response.place, response.velocity, response.time_s)
    at_rest = response.at_rest(1.0)
    response.later(5.0)
    assert (response.place, response.velocity, response.time_s) == before
    response.commanded(1.0, 0j)
    response.advance(15.0)
    assert response.place == pytest.approx(at_rest, abs=0.02)


def test_a_command_under_way_counts_for_the_place_of_rest() -> None:
    """It was sent, and the vehicle has not had the time to answer: it will."""
    response = Response(Agility(delay_s=0.3), 0.0)
    response.commanded(0.0, 2.0 + 0j)
    assert response.at_rest(0.2).real > 0.1
    assert response.later(0.2).place == 0j


def test_how_it_is_stepped_makes_no_difference() -> None:
    fine, coarse = Response(Agility(), 0.0), Response(Agility(), 0.0)
    for response in (fine, coarse):
        response.commanded(0.0, 3.0 - 1.0j)
    for step in range(1, 101):
        fine.advance(step * 0.03)
    coarse.advance(3.0)
    assert fine.place == pytest.approx(coarse.place, abs=0.03)
    assert fine.velocity == pytest.approx(coarse.velocity, abs=0.03)
