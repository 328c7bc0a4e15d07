"""What fails does fail, and only as long as it should: the bus, the link, the process, the sensor."""

from __future__ import annotations

import math
import random

import pytest

from drivers.aoa.model import SensorModel
from drivers.mavlink.setpoints import StreamLimits
from drivers.simulation.weather import CALM
from gcs.faults.bus import FaultyBus
from gcs.faults.fault import Fault, Kind, Moment
from gcs.faults.sensor import FaultySensor
from gcs.faults.vehicle import FaultyVehicle
from tests.fakes import ManualClock

BEARINGS, EMISSION = "bearing-relay/s/uav/U1/bearings", "bearing-relay/s/uav/U1/emission"


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def vehicle(clock: ManualClock) -> FaultyVehicle:
    return FaultyVehicle(0j, 5.0, StreamLimits(lease_s=60.0), clock, CALM, 1, 0.0, lambda _: None)


async def moved_m(vehicle: FaultyVehicle, clock: ManualClock, for_s: float) -> float:
    vehicle.advance()
    before = vehicle.place
    await clock.advance(for_s)
    vehicle.advance()
    return abs(vehicle.place - before)


def sick(kind: Kind, amount: float = 0.0, of: str | None = None) -> FaultySensor:
    sensor = FaultySensor(SensorModel(sigma_rad=0.001), random.Random(1), "1")
    sensor.strike(Fault(kind, "U1", Moment("U1", "LEG_1", 0.0), None, amount, 0.0, of))
    return sensor


def azimuths(sensor: FaultySensor, time_ns: int = 0) -> list[float]:
    report = sensor.measure(time_ns, 0j, {"L0": 10 + 0j, "L1": 10j})
    return [] if report is None else [bearing.azimuth_rad for bearing in report.bearings]


async def test_a_bus_that_is_gone_delivers_nothing_but_what_was_put_reliably_when_it_is_back(
    clock: ManualClock,
) -> None:
    bus, heard = FaultyBus(clock, 1), []
    bus.subscribe("bearing-relay/s/uav/*/bearings", lambda key, _: heard.append(key))
    bus.subscribe("bearing-relay/s/uav/*/emission", lambda key, _: heard.append(key))
    bus.go()
    bus.put_latest(BEARINGS, b"")
    bus.put_reliably(EMISSION, b"")
    assert (heard, bus.connected()) == ([], False)
    bus.come_back()
    assert (heard, bus.connected()) == ([EMISSION], True)


async def test_a_bus_loses_and_repeats_the_share_it_is_told(clock: ManualClock) -> None:
    bus, heard = FaultyBus(clock, 1), []
    bus.subscribe("bearing-relay/s/uav/*/bearings", lambda key, _: heard.append(key))
    bus.lost_share["U1"] = 0.3
    for _ in range(1000):
        bus.put_latest(BEARINGS, b"")
    assert 650 < len(heard) < 750
    heard.clear()
    bus.lost_share["U1"], bus.repeated_share["U1"] = 0.0, 1.0
    bus.put_latest(BEARINGS, b"")
    await clock.advance(1.0)
    bus.repeat()
    assert len(heard) == 2


async def test_without_setpoints_a_copter_stops_by_itself_and_goes_on_when_they_come_again(
    vehicle: FaultyVehicle, clock: ManualClock
) -> None:
    vehicle.renew(2 + 0j)
    await moved_m(vehicle, clock, 1.0)
    vehicle.cut_link(cut=True)
    assert await moved_m(vehicle, clock, 1.0) > 0.5
    await moved_m(vehicle, clock, 5.0)
    assert await moved_m(vehicle, clock, 1.0) < 0.05
    vehicle.cut_link(cut=False)
    assert await moved_m(vehicle, clock, 2.0) > 1.0


async def test_a_frozen_one_stands_still_in_time_and_is_not_heard(vehicle: FaultyVehicle, clock: ManualClock) -> None:
    vehicle.renew(2 + 0j)
    await moved_m(vehicle, clock, 2.0)
    vehicle.freeze(frozen=True)
    assert await moved_m(vehicle, clock, 3.0) == 0.0
    assert vehicle.silent_for_s() == pytest.approx(3.0)
    vehicle.freeze(frozen=False)
    assert vehicle.silent_for_s() == 0.0
    assert await moved_m(vehicle, clock, 0.5) > 0.5


async def test_who_drifts_does_so_whatever_it_is_told(vehicle: FaultyVehicle, clock: ManualClock) -> None:
    vehicle.drift(1j)
    assert await moved_m(vehicle, clock, 3.0) == pytest.approx(3.0, abs=0.1)
    vehicle.drift(0j)
    assert await moved_m(vehicle, clock, 3.0) < 0.1


def test_a_sensor_jumps_for_one_transmitter_sticks_or_says_nothing() -> None:
    ahead_rad, right_rad = azimuths(sick("sensor_jump", 1.5, "L1"))
    assert (math.sin(ahead_rad), right_rad) == pytest.approx((0.0, math.pi / 2 + 1.5), abs=0.01)
    assert azimuths(sick("sensor_silent")) == []
    stuck = sick("sensor_stuck")
    assert azimuths(stuck) == azimuths(stuck, 10**8) != []


def test_a_clock_is_set_and_drifts_from_when_it_is_struck() -> None:
    assert sick("clock_step", -0.5).clock_ns(10**9) == 5 * 10**8
    drifting = sick("clock_drift", 0.001)
    azimuths(drifting, 0)
    assert drifting.clock_ns(10**9) == 1_001_000_000


def test_the_truth_about_a_capture_is_kept_whatever_the_clock_says() -> None:
    sensor = sick("clock_step", 5.0)
    report = sensor.measure(123, 0j, {"L0": 10 + 0j})
    assert report.captured_ns == 5_000_000_123
    assert sensor.captured_ns[report.sequence] == 123
