"""An autopilot that reboots, on the ground and in flight: what the service notices of it, and what it does."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits, StreamState
from planner.frames import GeodeticPosition
from tests.drivers.mavlink.benched import Bench

HOME = GeodeticPosition(-35.363262, 149.165237, 584.0)
REBOOT = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
FORCED = (1, 0, 0, 0, 0, 20190226)
ALTITUDE_M = 10.0


@pytest.fixture
def bench(clock):
    return Bench(clock)


@pytest.fixture
def vehicle(bench):
    vehicle = bench.add("U1", HOME)
    vehicle.notices = []
    vehicle.on_notice.append(vehicle.notices.append)
    return vehicle


async def test_rates_lost_with_a_reboot_are_back_within_seconds(bench, vehicle):
    await bench.until_done(asyncio.create_task(ArduCopter().prepare(vehicle)))
    await bench.pass_time(20.0)
    vehicle.tell(REBOOT, 1)
    await bench.pass_time(8.0)
    assert vehicle.reboots == 1
    assert vehicle.rates.missing == ()
    assert vehicle.clock.now_s() - vehicle.telemetry.kinematics.time_s <= 0.3
    assert vehicle.notices == ["U1 stopped sending what was asked of it, and was asked again", "U1 has rebooted"]


async def test_every_reboot_is_counted_once(bench, vehicle):
    await bench.until_done(asyncio.create_task(ArduCopter().prepare(vehicle)))
    for number in (1, 2, 3):
        await bench.pass_time(15.0)
        vehicle.tell(REBOOT, 1)
        await bench.pass_time(15.0)
        assert vehicle.reboots == number


async def test_a_link_that_is_silent_for_a_while_is_no_reboot(bench, vehicle):
    await bench.until_done(asyncio.create_task(ArduCopter().prepare(vehicle)))
    await bench.pass_time(20.0)
    vehicle.link.garble = lambda _message: None
    await bench.pass_time(12.0)
    vehicle.link.garble = lambda message: message
    await bench.pass_time(5.0)
    assert vehicle.reboots == 0
    assert vehicle.rates.missing == ()


async def test_rates_that_another_station_takes_away_are_asked_for_again_and_are_no_reboot(bench, vehicle):
    await bench.until_done(asyncio.create_task(ArduCopter().prepare(vehicle)))
    vehicle.tell(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, -1)
    await bench.pass_time(8.0)
    assert vehicle.rates.missing == ()
    assert vehicle.reboots == 0
    assert vehicle.notices == ["U1 stopped sending what was asked of it, and was asked again"]


async def test_a_vehicle_that_reboots_in_flight_is_no_longer_the_services_and_gets_no_setpoint(bench, vehicle):
    autopilot = ArduCopter()
    await bench.until_done(asyncio.create_task(autopilot.prepare(vehicle)))
    await bench.until_done(asyncio.create_task(autopilot.take_off(vehicle, ALTITUDE_M)))
    stream = SetpointStreamer(vehicle, autopilot, ALTITUDE_M, StreamLimits(), vehicle.clock)
    running = asyncio.create_task(stream.run())
    for _ in range(20):
        stream.renew(2.0 + 0j)
        await bench.pass_time(0.1)
    assert stream.state is StreamState.LEASED
    vehicle.tell(REBOOT, *FORCED)
    for _ in range(17):
        stream.renew(2.0 + 0j)
        await bench.pass_time(0.1)
    assert stream.state is StreamState.PILOT, "the first heartbeat after the reboot is in no guided mode"
    sent = len(vehicle.link.setpoints)
    for _ in range(50):
        stream.renew(2.0 + 0j)
        await bench.pass_time(0.1)
    assert len(vehicle.link.setpoints) == sent
    assert vehicle.reboots == 1
    assert mavlink.MAV_CMD_DO_SET_MODE not in vehicle.link.commands[vehicle.link.commands.index(REBOOT) :]
    running.cancel()
