"""Two directions agree on some place whatever they say: it counts only where the receiver can have flown to."""

from __future__ import annotations

import math
from collections.abc import Collection

import pytest

from planner.angles import wrap
from tests.gcs.test_stop_monitor import LEGS, Flight

TWO = ("L0", "L1")
THREE = ("L0", "L1", "U7")


class Hearing(Flight):
    """A receiver that hears some transmitters, one of which may lie."""

    def __init__(self, heard: Collection[str], sigma_deg: float, seed: int) -> None:
        super().__init__(LEGS["away"], sigma_deg, seed)
        self.heard, self.lie_rad = heard, 0.0

    def directions(self) -> dict[str, float]:
        said = {name: at for name, at in super().directions().items() if name in self.heard}
        said["L1"] = wrap(said["L1"] + self.lie_rad)
        return said

    def fly_and_stand(self) -> None:
        """Fly a part of the leg, and come to rest."""
        for _ in range(30):
            assert not self.step()
        self.hover(40)

    def hover(self, count: int) -> list[frozenset[str]]:
        """Be told to stand, and return whose directions agreed in each report."""
        self.command = 0j
        self.monitor.commanded(self.time_s, 0j)
        agreed = []
        for _ in range(count):
            agreed.append(self.observe(self.directions()))
            self.move()
        return agreed

    def off_m(self) -> float:
        return abs(self.monitor.place()[0] - self.place)


@pytest.mark.parametrize("jump_deg", [2.4, -2.4, 5.0, 45.0, 180.0])
@pytest.mark.parametrize("seed", range(3))
def test_of_two_that_are_heard_one_that_jumps_is_not_believed_however_long_it_lasts(jump_deg: float, seed: int) -> None:
    flight = Hearing(TWO, 0.1, seed)
    flight.fly_and_stand()
    flight.lie_rad = math.radians(jump_deg)
    assert all(len(agreeing) < 2 for agreeing in flight.hover(80))
    assert flight.off_m() < 0.6


def test_it_is_told_apart_from_a_contradiction() -> None:
    flight = Hearing(TWO, 0.1, 1)
    flight.fly_and_stand()
    flight.lie_rad = math.radians(2.4)
    flight.hover(5)
    assert not flight.monitor.disbelieved
    flight.hover(25)
    assert flight.monitor.disbelieved
    flight.lie_rad = 0.0
    flight.hover(5)
    assert not flight.monitor.disbelieved


def test_when_it_has_passed_the_leg_is_flown_on() -> None:
    flight = Hearing(TWO, 0.1, 2)
    flight.fly_and_stand()
    flight.lie_rad = math.radians(3.0)
    flight.hover(40)
    flight.lie_rad = 0.0
    assert flight.hover(3)[-1] == {"L0", "L1"}
    assert flight.fly() < 0.8


def test_what_the_sensor_s_noise_may_be_is_no_lie() -> None:
    flight = Hearing(TWO, 0.5, 3)
    flight.fly_and_stand()
    flight.lie_rad = math.radians(1.0)
    assert all(agreeing == {"L0", "L1"} for agreeing in flight.hover(20)[5:])


def test_a_gust_s_shove_is_believed_of_two() -> None:
    """Half a metre within a second is within what the air may do, and what bearings say of it is taken in."""
    flight = Hearing(TWO, 0.1, 4)
    flight.fly_and_stand()
    for _ in range(5):
        flight.place += 0.1j * flight.monitor.course
        flight.step()
    assert flight.hover(15)[-1] == {"L0", "L1"}
    assert flight.off_m() < 0.4


def test_a_third_bears_out_that_the_receiver_is_somewhere_else() -> None:
    flight = Hearing(THREE, 0.1, 5)
    flight.fly_and_stand()
    flight.place += 4 * flight.monitor.course
    agreed = flight.hover(40)
    assert len(agreed[0]) < 3
    assert agreed[-1] == {"L0", "L1", "U7"}
    assert flight.off_m() < 0.6
    assert not flight.monitor.disbelieved


def test_of_three_the_one_that_lies_is_left_out_and_the_leg_goes_on() -> None:
    flight = Hearing(THREE, 0.1, 6)
    flight.fly_and_stand()
    flight.lie_rad = math.radians(3.0)
    assert all(agreeing == {"L0", "U7"} for agreeing in flight.hover(30))
    assert flight.off_m() < 0.6


@pytest.mark.parametrize(("stopped", "believed"), [(False, False), (True, True)])
def test_who_was_forbidden_to_move_may_have_flown_on(*, stopped: bool, believed: bool) -> None:
    """Its link was cut: it flew on for a while. Of one that nobody stopped, that is not believed."""
    flight = Hearing(TWO, 0.1, 7)
    flight.monitor.begin(flight.time_s)
    flight.fly_and_stand()
    if stopped:
        flight.monitor.begin(flight.time_s)
    flight.place += 4 * flight.monitor.course
    assert (flight.hover(30)[-1] == {"L0", "L1"}) is believed
    assert flight.monitor.disbelieved is not believed
