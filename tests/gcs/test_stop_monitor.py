"""The stop-condition monitor follows a leg from angles alone, and ends it never on one sample."""

from __future__ import annotations

import cmath
import math
import random

import numpy as np
import pytest

from gcs.guidance import SpeedLimits, leg_velocity
from gcs.stop_monitor import SLOT, TURN, ArrivalRule, StopMonitor
from planner.angles import wrap
from planner.plan import Leg
from planner.routes import make_leg

PLACES = {"L0": 0j, "L1": 100 + 0j, "U7": -40 + 120j}
PERIOD_S = 0.1
RESPONSE_S = 0.5
LIMITS = SpeedLimits()


def a_leg(start: complex, end: complex, guide: str, reference: tuple[str, str] = ("L0", "L1")) -> Leg:
    first, second = reference
    return make_leg(
        start,
        end,
        (guide, PLACES[guide]),
        ((first, PLACES[first]), (second, PLACES[second])),
    )


class Flight:
    """A receiver that answers velocity with a lag, a noisy sensor, and the loop between them."""

    def __init__(
        self,
        leg: Leg,
        sigma_deg: float,
        seed: int,
        rule: ArrivalRule = SLOT,
        start: complex | None = None,
    ):
        self.sigma_rad = math.radians(sigma_deg)
        self.noise = random.Random(seed)
        self.place = leg.start if start is None else start
        self.velocity = 0j
        self.time_s = 1000.0
        self.monitor = StopMonitor(leg, PLACES, leg.start, np.eye(2) * 0.5, self.time_s, rule)

    def directions(self) -> dict[str, float]:
        return {
            name: wrap(cmath.phase(at - self.place) + self.noise.gauss(0.0, self.sigma_rad))
            for name, at in PLACES.items()
        }

    def observe(self, directions: dict[str, float]) -> frozenset[str]:
        return self.monitor.observe(self.time_s, directions, dict.fromkeys(PLACES, max(self.sigma_rad, 1e-4)))

    def step(self, directions: dict[str, float] | None = None) -> bool:
        """One report, one command, one tenth of a second; True when the stop condition holds."""
        if len(self.observe(directions or self.directions())) > 1:
            now = self.monitor.whereabouts(self.time_s)
            if self.monitor.arrived(now):
                return True
            velocity = leg_velocity(now, LIMITS)
            self.monitor.commanded(self.time_s, velocity)
            self.command = self.monitor.course * velocity
        self.move()
        return False

    def move(self) -> None:
        """Fly for a tenth of a second as commanded."""
        for _ in range(10):
            self.velocity += (self.command + self.stray() - self.velocity) * (PERIOD_S / 10) / RESPONSE_S
            self.place += self.velocity * PERIOD_S / 10
        self.time_s += PERIOD_S

    command = 0j

    def stray(self) -> complex:
        """What the vehicle flies besides what it is told, m/s."""
        return 0j

    def fly(self, limit_s: float = 90.0) -> float:
        """Fly to the end and return how far from it the receiver stands, m."""
        while not self.step():
            assert self.time_s < 1000.0 + limit_s, "the leg did not end"
        return abs(self.place - self.monitor.leg.end)


LEGS = {
    "towards": a_leg(80 + 90j, 50 + 56.25j, "L0"),
    "away": a_leg(30 + 40j, 60 + 80j, "L0"),
    "along the other guide": a_leg(60 + 120j, 80 + 60j, "L1"),
    "own stop reference": a_leg(30 + 40j, 60 + 80j, "L0", ("L1", "U7")),
    "angles near the seam": a_leg(20 + 2j, 60 + 6j, "L0"),
    "no length at all": a_leg(60 + 80j, 60 + 80j, "L0"),
}


@pytest.mark.parametrize("leg", LEGS.values(), ids=LEGS.keys())
def test_a_leg_ends_where_its_angle_says(leg: Leg) -> None:
    assert Flight(leg, sigma_deg=0.02, seed=1).fly() < 0.25


@pytest.mark.parametrize("seed", range(8))
def test_noise_costs_no_more_than_geometry_forces(seed: int) -> None:
    """At 0.1 degree the stop reference sees 0.14 degree of noise: 0.25 m across a sight line of 100 m."""
    assert Flight(LEGS["away"], sigma_deg=0.1, seed=seed).fly() < 0.8


def test_a_receiver_off_its_line_is_brought_back() -> None:
    leg = LEGS["away"]
    flight = Flight(leg, 0.02, 3, start=leg.start + 1.5j)
    assert flight.fly() < 0.25


class Restless(Flight):
    """A receiver whose own velocity estimate wanders, as PX4's does on its simulated sensors."""

    def stray(self) -> complex:
        return 0.3 * cmath.exp(1j * self.time_s / 1.3)


def test_a_vehicle_that_cannot_hold_still_in_the_band_is_let_off_near_its_end() -> None:
    for leg in LEGS.values():
        assert Restless(leg, 0.02, 5).fly(limit_s=60.0) < 0.7


def test_never_on_one_sample() -> None:
    """A single report that shows the stop angle, in the middle of the leg, does not end it."""
    leg = LEGS["away"]
    flight = Flight(leg, 0.05, 4, rule=ArrivalRule(band_m=5.0, dwell_s=0.3, on_line=False))
    for _ in range(20):
        assert not flight.step()
    at_the_end = {name: cmath.phase(at - leg.end) for name, at in PLACES.items()}
    assert abs(flight.place - leg.end) > 20.0
    assert not flight.step(at_the_end)
    assert not flight.monitor.dwelling


@pytest.mark.parametrize("jump_deg", [9.0, 12.0, 45.0, 180.0])
def test_a_multipath_jump_is_recognised_and_takes_no_other_bearing_along(
    jump_deg: float,
) -> None:
    flight = Flight(LEGS["away"], 0.1, 5)
    jumps = 0
    while True:
        directions = flight.directions()
        if flight.noise.random() < 0.05:
            directions["L0"] = wrap(directions["L0"] + math.radians(jump_deg))
            jumps += 1
            assert flight.observe(directions) == {"L1", "U7"}
            continue
        if flight.step(directions):
            break
    assert flight.monitor.outliers == jumps > 0
    assert abs(flight.place - flight.monitor.leg.end) < 0.5


@pytest.mark.parametrize("jump_deg", [9.0, 12.0, 45.0, 180.0])
@pytest.mark.parametrize("sigma_deg", [0.1, 0.5, 1.0])
def test_five_percent_of_multipath_jumps_cost_next_to_nothing(sigma_deg: float, jump_deg: float) -> None:
    def off_m(share: float, seed: int) -> float:
        flight = Flight(LEGS["away"], sigma_deg, seed)
        jumps = random.Random(seed)
        while True:
            directions = flight.directions()
            for name in directions:
                if jumps.random() < share:
                    directions[name] = wrap(directions[name] + jumps.choice((-1, 1)) * math.radians(jump_deg))
            if flight.step(directions):
                return abs(flight.place - flight.monitor.leg.end)
            assert flight.time_s < 1090.0

    clean, hit = (np.mean([off_m(share, seed) for seed in range(5)]) for share in (0.0, 0.05))
    assert hit < 1.2 * clean + 0.1


def test_a_sensor_that_repeats_itself_under_way_is_stuck() -> None:
    flight = Flight(LEGS["away"], 0.1, 5)
    for _ in range(30):
        flight.step()
    frozen = flight.directions()
    assert flight.observe(frozen) == PLACES.keys()
    assert not flight.observe(frozen)
    assert flight.monitor.stuck
    assert flight.observe(flight.directions())
    assert not flight.monitor.stuck


def test_a_hovering_receiver_may_measure_the_same_again() -> None:
    leg = LEGS["no length at all"]
    flight = Flight(leg, 0.0, 1)
    for _ in range(50):
        if flight.step():
            break
    assert flight.monitor.dwelling
    assert not flight.monitor.stuck


def test_reports_that_keep_agreeing_win_over_the_prediction() -> None:
    """The vehicle was shoved 15 m along L0's line: the others look like outliers, then the filter believes them."""
    flight = Flight(LEGS["away"], 0.1, 6)
    for _ in range(15):
        flight.step()
    flight.place += 15 * flight.monitor.course
    assert flight.observe(flight.directions()) == {"L0"}
    assert flight.fly() < 0.8


def test_bearings_late_or_out_of_order_do_not_turn_time_back() -> None:
    flight = Flight(LEGS["away"], 0.02, 7)
    for _ in range(10):
        flight.step()
    before = flight.monitor.whereabouts(flight.time_s)
    flight.monitor.observe(flight.time_s - 0.3, flight.directions(), dict.fromkeys(PLACES, 1e-3))
    after = flight.monitor.whereabouts(flight.time_s)
    assert after.seen == pytest.approx(before.seen, abs=0.5)


def test_a_transmitter_nobody_knows_the_place_of_is_ignored() -> None:
    flight = Flight(LEGS["away"], 0.1, 8)
    assert flight.observe({**flight.directions(), "stranger": 1.0}) == PLACES.keys()
    assert not flight.monitor.outliers


def test_without_reports_the_estimate_follows_the_command_and_grows_unsure() -> None:
    flight = Flight(LEGS["away"], 0.1, 8)
    flight.observe(flight.directions())
    flight.monitor.commanded(flight.time_s, 2.0 + 0j)
    soon, later = (flight.monitor.estimate(flight.monitor.whereabouts(flight.time_s + after)) for after in (0.5, 5.0))
    assert soon.remaining_m - later.remaining_m == pytest.approx(2.0 * 4.5, rel=0.2)
    assert later.progress_mps == pytest.approx(2.0, abs=0.1)
    assert later.remaining_sigma_m > soon.remaining_sigma_m


def test_the_place_and_its_covariance_come_from_the_bearings() -> None:
    flight = Flight(LEGS["away"], 0.05, 9)
    flight.fly()
    place, covariance = flight.monitor.place()
    assert abs(place - flight.place) < 0.3
    assert np.allclose(covariance, covariance.T)
    assert np.all(np.linalg.eigvalsh(covariance) > 0)
    assert math.sqrt(float(np.linalg.eigvalsh(covariance)[-1])) < 0.3


def test_a_transmitter_that_may_stand_elsewhere_makes_the_place_unsure() -> None:
    """However often it is heard: what is unknown of its place stays, in the direction it is good for."""
    leg = LEGS["away"]
    sigmas = []
    for place_sigma_m in (0.0, 1.0):
        monitor = StopMonitor(leg, PLACES, leg.end, np.eye(2), 1000.0, SLOT, {"L1": place_sigma_m})
        for k in range(100):
            directions = {name: cmath.phase(PLACES[name] - leg.end) for name in ("L0", "L1")}
            monitor.observe(1000.0 + k * PERIOD_S, directions, dict.fromkeys(PLACES, 1e-3))
        sigmas.append(math.sqrt(float(np.linalg.eigvalsh(monitor.place()[1])[-1])))
    assert sigmas[0] < 0.15
    assert 0.5 < sigmas[1] < 1.5


@pytest.mark.parametrize(("rule", "ends"), [(TURN, True), (SLOT, False)])
def test_a_turning_point_may_be_passed_off_the_line_a_slot_may_not(rule: ArrivalRule, ends: bool) -> None:
    leg = LEGS["away"]
    beside = leg.end + 1j * leg.end / abs(leg.end)
    monitor = StopMonitor(leg, PLACES, beside, np.eye(2) * 1e-4, 1000.0, rule)
    directions = {name: cmath.phase(at - beside) for name, at in PLACES.items()}
    held = []
    for k in range(20):
        monitor.observe(1000.0 + k * PERIOD_S, directions, dict.fromkeys(PLACES, 1e-3))
        held.append(monitor.arrived(monitor.whereabouts(1000.0 + k * PERIOD_S)))
    assert any(held) is ends
