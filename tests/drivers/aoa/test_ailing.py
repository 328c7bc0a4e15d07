"""A simulated sensor ails from when it is told to, in what it is told, and is well again when nothing is left."""

from __future__ import annotations

import math
import random

import pytest

from drivers.aoa.ailing import AilingSensor
from drivers.aoa.model import SensorModel, SimulatedSensor
from drivers.aoa.reporting import ReportingSensor
from drivers.bus.messages import Ailment, SensorFault

MODEL = SensorModel(sigma_rad=0.001)
HEARD = {"L0": 10 + 0j, "L1": 10j}
WELL = SensorFault(silent=False)


@pytest.fixture
def sensor() -> AilingSensor:
    return AilingSensor(MODEL, random.Random(1))


def azimuths(sensor: SimulatedSensor, time_ns: int = 0) -> list[float]:
    report = sensor.measure(time_ns, 0j, HEARD)
    return [] if report is None else [bearing.azimuth_rad for bearing in report.bearings]


def test_well_it_is_the_plain_sensor_and_again_after_an_illness(sensor: AilingSensor) -> None:
    plain = SimulatedSensor(MODEL, random.Random(1))
    assert azimuths(sensor) == azimuths(plain)
    sensor.suffer([Ailment("sensor_bias", 0.3), Ailment("clock_step", 7.0)], 1)
    assert azimuths(sensor, 1) != azimuths(plain, 1)
    sensor.suffer([], 2)
    assert sensor.measure(2, 0j, HEARD) == plain.measure(2, 0j, HEARD)


def test_what_turns_bearings_adds_up_by_transmitter(sensor: AilingSensor) -> None:
    sensor.suffer([Ailment("sensor_bias", 0.3), Ailment("sensor_jump", 1.0, "L1")], 0)
    ahead_rad, right_rad = azimuths(sensor)
    assert (ahead_rad, right_rad) == pytest.approx((0.3, math.pi / 2 + 1.3), abs=0.01)


def test_what_is_silent_numbers_what_it_does_not_say(sensor: AilingSensor) -> None:
    sensor.silent = True
    assert azimuths(sensor) == []
    sensor.silent = False
    report = sensor.measure(1, 0j, HEARD)
    assert report is not None
    assert report.sequence == 2


def test_a_stuck_one_repeats_itself_and_its_numbers_go_on(sensor: AilingSensor) -> None:
    shown = azimuths(sensor)
    sensor.suffer([Ailment("sensor_stuck")], 1)
    assert [azimuths(sensor, time_ns) for time_ns in (1, 2)] == [shown, shown]
    sensor.suffer([], 3)
    assert azimuths(sensor, 3) != shown


def test_a_clock_drifts_from_when_it_began_to_whatever_strikes_later(sensor: AilingSensor) -> None:
    drift, second_ns = Ailment("clock_drift", 0.001), 10**9
    assert sensor.clock_ns(second_ns) == second_ns
    sensor.suffer([drift], second_ns)
    assert sensor.clock_ns(2 * second_ns) == 2_001_000_000
    sensor.suffer([drift, Ailment("clock_step", -0.5)], 2 * second_ns)
    assert sensor.clock_ns(3 * second_ns) == 2_502_000_000


def test_reports_get_lost_doubled_and_late_in_the_share_they_are_told_and_the_same_again() -> None:
    bad = SensorFault(silent=False, loss=0.3, duplication=0.5, delay_s=0.5, jitter_s=0.2)

    def arrivals(seed: str) -> list[list[float]]:
        sensor = ReportingSensor(MODEL, seed)
        assert sensor.arrivals_s() == [MODEL.latency_s]
        sensor.suffer_all(bad, 0)
        return [sensor.arrivals_s() for _ in range(1000)]

    found = arrivals("1")
    assert found == arrivals("1") != arrivals("2")
    assert sum(not copies for copies in found) / 1000 == pytest.approx(0.3, abs=0.05)
    assert sum(len(copies) == 2 for copies in found) / 1000 == pytest.approx(0.35, abs=0.05)
    firsts = [copies[0] for copies in found if copies]
    assert MODEL.latency_s + 0.5 <= min(firsts) < max(firsts) <= MODEL.latency_s + 0.7


def test_what_befalls_reports_leaves_the_noise_as_it_was() -> None:
    one, other = ReportingSensor(MODEL, "1"), ReportingSensor(MODEL, "1")
    one.suffer_all(SensorFault(silent=False, loss=0.5, duplication=0.5), 0)
    one.arrivals_s()
    assert azimuths(one) == azimuths(other)
