"""Simulated sensors: as noisy, late and lossy as they were told to be, and deaf where a real one would be."""

import asyncio
import cmath
import contextlib
import itertools
import math
import os
import sys

import msgspec
import pytest

from drivers.aoa.model import ClockFault, SensorFaults
from drivers.aoa.simulated import SensorSettings, run_sensors
from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import (
    Ailment,
    BearingReport,
    ClockPing,
    ClockPong,
    Emission,
    PositionReport,
    SensorFault,
    decode,
    encode,
)
from drivers.bus.session import BusEndpoint, open_bus
from drivers.clock import SystemClock
from drivers.simulation.launcher import free_tcp_port
from tests.fakes import FakeBus, ManualClock, settle

KEYS = SwarmKeys("test")
PATIENCE_S = 60.0
SIGMA_RAD = math.radians(0.5)
BEACONS = {"L0": (0.0, 0.0), "L1": (100.0, 0.0)}
NO_NOISE = SensorSettings(
    swarm="test",
    endpoint="",
    receivers=["U1", "U2"],
    beacons=BEACONS,
    sigma_rad=0.0,
    rate_hz=10.0,
    latency_s=0.1,
    drop_out=0.0,
    seed=1,
    speedup=1.0,
    epoch_ns=0,
    parent_pid=0,
)


def azimuth_error_rad(azimuth_rad, true_rad):
    return math.remainder(azimuth_rad - true_rad, math.tau)


class World:
    """Sensors at work on a bus in memory; positions are repeated every 0.1 s for as long as they are in `places`."""

    def __init__(self, settings=NO_NOISE):
        self.bus, self.clock = FakeBus(), ManualClock()
        self.settings = settings
        self.places = {"U1": 50 + 50j}
        self.velocities = {}
        self.headings_rad = {}

    @contextlib.asynccontextmanager
    async def running(self):
        task = asyncio.create_task(run_sensors(self.settings, self.bus, self.clock))
        await settle()
        try:
            yield self
            assert not task.done(), "the sensors ended"
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    def emit(self, name, *, on=True):
        self.bus.put_reliably(KEYS.emission(name), encode(Emission(on)))

    def put_position(self, name, place, velocity=0j, age_s=0.0):
        time_ns = self.clock.unix_ns() - round(age_s * 1e9)
        heading_rad = self.headings_rad.get(name)
        report = PositionReport(time_ns, place.real, place.imag, -10.0, velocity.real, velocity.imag, heading_rad)
        self.bus.put_latest(KEYS.position(name), encode(report))

    async def let_pass(self, duration_s):
        for _ in range(round(duration_s / 0.1)):
            for name, place in self.places.items():
                self.put_position(name, place, self.velocities.get(name, 0j))
            await self.clock.advance(0.1)

    def reports(self, name="U1"):
        return [decode(payload, BearingReport) for payload in self.bus.payloads(KEYS.bearings(name))]

    def heard(self, name="U1"):
        """Return whom the last report of a sensor hears."""
        return {bearing.transmitter for bearing in self.reports(name)[-1].bearings}


@pytest.fixture
def make_world():
    return World


@pytest.fixture
async def world():
    async with World().running() as world:
        yield world


def with_settings(**changes):
    return msgspec.structs.replace(NO_NOISE, **changes)


async def test_a_receiver_hears_the_beacons_that_emit_where_they_are(world):
    world.emit("L0")
    world.emit("L1")
    await world.let_pass(1.0)
    bearings = {bearing.transmitter: bearing.azimuth_rad for bearing in world.reports()[-1].bearings}
    assert bearings == pytest.approx({"L0": math.radians(225), "L1": math.radians(315)})
    assert KEYS.bearings("U1") in world.bus.urgent_keys


async def test_silent_transmitters_are_not_heard(world):
    world.emit("L0")
    await world.let_pass(0.5)
    assert world.heard() == {"L0"}
    world.emit("L1")
    world.emit("L0", on=False)
    await world.let_pass(0.5)
    assert world.heard() == {"L1"}
    world.emit("L1", on=False)
    await world.let_pass(0.3)
    left = len(world.reports())
    await world.let_pass(1.0)
    assert len(world.reports()) == left


async def test_a_receiver_never_hears_itself_but_others_that_emit(world):
    world.places["U2"] = 50 + 150j
    for name in ("L0", "U1", "U2"):
        world.emit(name)
    await world.let_pass(0.5)
    assert world.heard("U1") == {"L0", "U2"}
    assert world.heard("U2") == {"L0", "U1"}


async def test_whoever_emitted_before_the_sensors_started_is_heard(make_world):
    world = make_world()
    world.emit("L0")
    async with world.running():
        await world.let_pass(0.5)
        assert world.heard() == {"L0"}


async def test_reports_come_at_the_rate_each_after_the_latency_and_numbered(make_world):
    world = make_world(with_settings(rate_hz=5.0, latency_s=0.35))
    came_s = []
    world.bus.subscribe(KEYS.every_bearings, lambda key, payload: came_s.append(world.clock.now_s()))
    world.emit("L0")
    started_s, started_ns = world.clock.now_s(), world.clock.unix_ns()
    async with world.running():
        await world.let_pass(4.0)
    captured_s = [started_s + (report.captured_ns - started_ns) * 1e-9 for report in world.reports()]
    delays = [arrival - capture for arrival, capture in zip(came_s, captured_s, strict=True)]
    assert delays == pytest.approx([0.35] * len(delays), abs=1e-6)
    assert len(delays) == pytest.approx((4.0 - 0.35) * 5, abs=1)
    periods = [later - earlier for earlier, later in itertools.pairwise(captured_s)]
    assert periods == pytest.approx([0.2] * len(periods), abs=1e-6)
    sequence = [report.sequence for report in world.reports()]
    assert sequence == list(range(sequence[0], sequence[0] + len(sequence)))


async def test_after_a_pause_of_the_process_the_sensors_do_not_catch_up_with_a_burst(world):
    world.emit("L0")
    await world.let_pass(1.0)
    before = len(world.reports())
    world.clock.jump(10.0)
    await world.let_pass(0.5)
    assert 4 <= len(world.reports()) - before <= 8


async def test_a_sensor_whose_own_position_is_stale_or_unknown_is_silent(world):
    world.emit("L0")
    await world.let_pass(0.5)
    assert world.reports("U2") == []
    del world.places["U1"]
    await world.clock.advance(1.3)
    left = len(world.reports())
    await world.clock.advance(5.0)
    assert len(world.reports()) == left
    world.places["U1"] = 10 + 10j
    await world.let_pass(0.3)
    assert len(world.reports()) > left


async def test_a_position_that_is_old_when_it_comes_is_not_simulated_on(world):
    world.emit("L0")
    for _ in range(20):
        world.put_position("U2", 5 + 5j, age_s=1.5)
        await world.clock.advance(0.1)
    assert world.reports("U2") == []


async def test_a_transmitter_whose_position_is_stale_is_not_heard(world):
    world.places["U2"] = 0 + 50j
    world.emit("L0")
    world.emit("U2")
    await world.let_pass(0.5)
    assert world.heard() == {"L0", "U2"}
    del world.places["U2"]
    await world.let_pass(1.5)
    assert world.heard() == {"L0"}


async def test_between_positions_a_moving_uav_is_carried_on(make_world):
    world = make_world(with_settings(rate_hz=20.0, latency_s=0.0))
    world.emit("L0")
    placed_ns = world.clock.unix_ns()
    async with world.running():
        world.put_position("U1", -10 + 0j, velocity=10j)
        await world.clock.advance(0.8)
    turned = [report.bearings[0].azimuth_rad for report in world.reports()]
    seconds = [(report.captured_ns - placed_ns) * 1e-9 for report in world.reports()]
    expected = [cmath.phase(10 - 10j * elapsed_s) % math.tau for elapsed_s in seconds]
    assert [azimuth_error_rad(at, to) for at, to in zip(turned, expected, strict=True)] == pytest.approx(
        [0.0] * len(turned), abs=1e-6
    )
    assert len(turned) > 10


async def test_a_sensor_fault_silences_that_sensor_until_it_is_lifted(world):
    world.places["U2"] = 0 + 50j
    world.emit("L0")
    await world.let_pass(0.5)
    world.bus.put_latest(KEYS.sensor_fault("U1"), encode(SensorFault(silent=True)))
    await world.let_pass(0.2)
    left, others = len(world.reports("U1")), len(world.reports("U2"))
    await world.let_pass(1.0)
    assert len(world.reports("U1")) == left
    assert len(world.reports("U2")) > others
    world.bus.put_latest(KEYS.sensor_fault("U1"), encode(SensorFault(silent=False)))
    await world.let_pass(0.5)
    assert len(world.reports("U1")) > left


async def test_reports_are_lost_doubled_and_turned_as_a_fault_says_and_are_well_again_after_it(world):
    world.emit("L0")
    await world.let_pass(0.5)
    world.bus.put_latest(KEYS.sensor_fault("U1"), encode(SensorFault(silent=False, loss=1.0)))
    await world.let_pass(0.3)
    left = len(world.reports())
    await world.let_pass(1.0)
    assert len(world.reports()) == left
    turned = SensorFault(silent=False, ailments=[Ailment("sensor_bias", 0.25)], duplication=1.0)
    world.bus.put_latest(KEYS.sensor_fault("U1"), encode(turned))
    await world.let_pass(2.0)
    reports = world.reports()[left:]
    assert len(reports) > 1.5 * len({report.sequence for report in reports})
    assert math.degrees(reports[-1].bearings[0].azimuth_rad) == pytest.approx(225 + math.degrees(0.25))
    world.bus.put_latest(KEYS.sensor_fault("U1"), encode(SensorFault(silent=False)))
    await world.let_pass(1.5)
    assert math.degrees(world.reports()[-1].bearings[0].azimuth_rad) == pytest.approx(225)


async def test_a_clock_begins_to_drift_when_it_is_told_to(world):
    world.emit("L0")
    await world.let_pass(1.0)
    drifting = SensorFault(silent=False, ailments=[Ailment("clock_drift", 0.05)])
    world.bus.put_latest(KEYS.sensor_fault("U1"), encode(drifting))
    await world.let_pass(10.0)
    ahead_s = (world.reports()[-1].captured_ns - world.clock.unix_ns()) * 1e-9
    assert ahead_s == pytest.approx(0.5 - 0.1, abs=0.15)


async def test_a_transmitter_that_is_muted_is_heard_by_nobody_though_it_emits(world):
    world.places["U2"] = 0 + 50j
    for name in ("L0", "L1", "U2"):
        world.emit(name)
    await world.let_pass(0.5)
    for name in ("L0", "U2"):
        world.bus.put_latest(KEYS.sensor_fault(name), encode(SensorFault(silent=False, muted=True)))
    await world.let_pass(0.5)
    assert world.heard("U1") == {"L1"}
    assert world.heard("U2") == {"L1"}
    world.bus.put_latest(KEYS.sensor_fault("L0"), encode(SensorFault(silent=False)))
    await world.let_pass(0.5)
    assert world.heard("U1") == {"L0", "L1"}


async def test_what_was_told_while_the_bus_was_gone_counts_when_it_is_back_but_nothing_older(world):
    world.emit("L0")
    await world.let_pass(1.0)
    world.bus.up = False
    world.emit("L0", on=False)
    world.emit("L1")
    world.bus.put_reliably(KEYS.sensor_fault("U1"), encode(SensorFault(silent=False, muted=True)))
    await world.let_pass(1.0)
    world.bus.up = True
    await world.let_pass(1.5)
    assert world.heard() == {"L1"}
    world.emit("L0")
    await world.let_pass(1.5)
    assert world.heard() == {"L0", "L1"}


async def test_what_is_told_while_it_is_asked_again_is_newer_than_the_answer(world):
    world.emit("L0")
    await world.let_pass(0.5)
    fetch = world.bus.fetch

    async def fetch_slowly(key_expression):
        answer = await fetch(key_expression)
        if key_expression == KEYS.every_emission:
            world.emit("L0", on=False)
            world.emit("L1")
        return answer

    world.bus.fetch = fetch_slowly
    world.bus.up = False
    await world.let_pass(1.0)
    world.bus.up = True
    await world.let_pass(1.5)
    assert world.heard() == {"L1"}


async def test_whoever_is_back_later_than_the_sensors_is_asked_again(world):
    world.emit("L0")
    await world.let_pass(1.0)
    world.bus.up = False
    world.emit("L1")
    remembered, world.bus._remembered = world.bus._remembered, {}
    await world.let_pass(1.0)
    world.bus.up = True
    await world.let_pass(1.5)
    assert world.heard() == {"L0"}
    world.bus._remembered = remembered
    await world.let_pass(1.5)
    assert world.heard() == {"L0", "L1"}


@pytest.mark.parametrize("payload", [b"", b"{}", b"\xff", b'{"on":1}', b'{"silent":"yes"}', b'{"north_m":NaN}'])
async def test_malformed_payloads_neither_end_the_sensors_nor_change_what_they_know(world, payload):
    world.emit("L0")
    await world.let_pass(0.3)
    for key in (KEYS.position("U1"), KEYS.emission("L0"), KEYS.sensor_fault("U1"), KEYS.position("stranger")):
        world.bus.put_latest(key, payload)
    before = len(world.reports())
    await world.clock.advance(0.5)
    assert len(world.reports()) >= before + 4
    assert all(bearing.transmitter == "L0" for report in world.reports() for bearing in report.bearings)


async def test_a_malformed_emission_remembered_from_before_does_not_end_the_sensors(make_world):
    world = make_world()
    world.bus.put_reliably(KEYS.emission("L1"), b"what?")
    world.emit("L0")
    async with world.running():
        await world.let_pass(0.5)
        assert world.heard() == {"L0"}


async def test_the_same_seed_puts_the_same_reports_on_the_bus(make_world):
    async def reports(seed):
        world = make_world(with_settings(sigma_rad=SIGMA_RAD, drop_out=0.2, seed=seed))
        world.emit("L0")
        world.emit("L1")
        async with world.running():
            await world.let_pass(2.0)
        return world.reports()

    first = await reports(4)
    assert len(first) > 5
    assert first == await reports(4)
    assert first != await reports(5)


async def test_reports_get_lost_and_bearings_are_rounded_as_told(make_world):
    step_rad = math.radians(8.0)
    world = make_world(with_settings(drop_out=0.5, resolution_rad=step_rad))
    world.emit("L0")
    async with world.running():
        await world.let_pass(20.0)
    assert 60 < len(world.reports()) < 140
    for report in world.reports():
        assert report.resolution_rad == step_rad
        assert math.degrees(report.bearings[0].azimuth_rad) == pytest.approx(224.0)


async def test_one_receivers_noise_does_not_depend_on_who_else_measures(make_world):
    async def reports(receivers):
        world = make_world(with_settings(sigma_rad=SIGMA_RAD, receivers=receivers))
        world.places["U2"] = 10 + 0j
        world.emit("L0")
        async with world.running():
            await world.let_pass(1.0)
        return world.reports("U1")

    assert await reports(["U1"]) == await reports(["U2", "U1"])


async def test_two_receivers_in_one_place_do_not_share_their_noise(make_world):
    world = make_world(with_settings(sigma_rad=SIGMA_RAD))
    world.places["U2"] = world.places["U1"]
    world.emit("L0")
    async with world.running():
        await world.let_pass(1.0)
    first, second = ([report.bearings[0].azimuth_rad for report in world.reports(name)] for name in ("U1", "U2"))
    assert set(first).isdisjoint(second)


async def test_each_receiver_has_its_own_faults(make_world):
    world = make_world(with_settings(faults={"U2": SensorFaults(bias_rad=0.25)}))
    world.places["U2"] = world.places["U1"]
    world.emit("L0")
    async with world.running():
        await world.let_pass(0.5)
    biased, plain = (world.reports(name)[-1].bearings[0].azimuth_rad for name in ("U2", "U1"))
    assert biased - plain == pytest.approx(0.25)


async def test_body_referenced_bearings_follow_the_nose(make_world):
    world = make_world(with_settings(reference="body"))
    world.emit("L0")
    async with world.running():
        await world.let_pass(0.5)
        assert math.degrees(world.reports()[-1].bearings[0].azimuth_rad) == pytest.approx(225)  # no heading: north
        world.headings_rad["U1"] = math.radians(30)
        await world.let_pass(0.5)
    last = world.reports()[-1]
    assert last.reference == "body"
    assert math.degrees(last.bearings[0].azimuth_rad) == pytest.approx(195)


async def test_reports_overtake_each_other_when_the_latency_jitters(make_world):
    world = make_world(with_settings(rate_hz=20.0, faults={"U1": SensorFaults(latency_jitter_s=0.3)}))
    came_s = []
    world.bus.subscribe(KEYS.every_bearings, lambda key, payload: came_s.append(world.clock.now_s()))
    world.emit("L0")
    started_s, started_ns = world.clock.now_s(), world.clock.unix_ns()
    async with world.running():
        await world.let_pass(5.0)
    delays = [
        at_s - started_s - (report.captured_ns - started_ns) * 1e-9
        for at_s, report in zip(came_s, world.reports(), strict=True)
    ]
    assert 0.1 - 1e-6 <= min(delays) < 0.15
    assert 0.35 < max(delays) <= 0.4 + 1e-6
    sequence = [report.sequence for report in world.reports()]
    assert sequence != sorted(sequence)
    assert len(sequence) == len(set(sequence)) > 80


@pytest.mark.parametrize("receivers", [["U1"], ["U1", "U2"]])
async def test_a_sensor_answers_for_the_clock_that_stamps_its_reports(make_world, receivers):
    clock = ClockFault(offset_s=3600.0, drift_ppm=100.0)
    world = make_world(with_settings(receivers=receivers, faults={"U1": SensorFaults(clock=clock)}))
    world.emit("L0")
    async with world.running():
        await world.let_pass(10.0)
        world.bus.put_latest(KEYS.clock_ping("U1"), encode(ClockPing(asked_ns=17)))
        (payload,) = world.bus.payloads(KEYS.clock_pong("U1"))
        pong = decode(payload, ClockPong)
        assert (pong.asked_ns, pong.received_ns) == (17, pong.answered_ns)
        ahead_s = (pong.received_ns - world.clock.unix_ns()) * 1e-9
        assert ahead_s == pytest.approx(3600.0 + 10.0 * 1e-4, abs=1e-4)
        captured_s = (world.reports()[-1].captured_ns - pong.received_ns) * 1e-9
        assert -0.3 < captured_s < 0.0
        for key, payload in ((KEYS.clock_ping("U1"), b"{}"), (KEYS.clock_ping("U9"), encode(ClockPing(1)))):
            world.bus.put_latest(key, payload)
        assert len(world.bus.payloads(KEYS.clock_pong("U1"))) == 1
        assert world.bus.payloads(KEYS.clock_pong("U9")) == []


async def test_a_bus_that_is_gone_does_not_end_the_sensors(world):
    world.emit("L0")
    world.bus.up = False
    await world.let_pass(2.0)
    world.bus.up = True
    await world.let_pass(0.5)
    assert world.heard() == {"L0"}


@pytest.mark.slow
async def test_the_sensor_process_measures_over_a_real_bus_and_ends_when_told_to():
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    settings = with_settings(endpoint=endpoint, sigma_rad=SIGMA_RAD, latency_s=0.0, parent_pid=os.getpid())
    reports = asyncio.Queue()
    async with open_bus(BusEndpoint(endpoint, role="router")) as bus:
        bus.subscribe(KEYS.every_bearings, lambda key, payload: reports.put_nowait((key, payload)))
        bus.put_reliably(KEYS.emission("L0"), encode(Emission(on=True)))
        clock = SystemClock()
        process = await _started(msgspec.json.encode(settings))
        try:
            async with asyncio.timeout(PATIENCE_S):
                while reports.empty():
                    position = PositionReport(clock.unix_ns(), 10.0, 0.0, -10.0, 0.0, 0.0)
                    bus.put_latest(KEYS.position("U1"), encode(position))
                    await asyncio.sleep(0.05)
            key, payload = reports.get_nowait()
            (bearing,) = decode(payload, BearingReport).bearings
            assert key == KEYS.bearings("U1")
            assert abs(azimuth_error_rad(bearing.azimuth_rad, math.pi)) < 6 * SIGMA_RAD
            process.terminate()
            async with asyncio.timeout(3.0):
                assert await process.wait() == 0
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()


@pytest.mark.slow
async def test_the_sensor_process_without_a_bus_says_so_in_one_line():
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    process = await _started(msgspec.json.encode(with_settings(endpoint=endpoint)))
    async with asyncio.timeout(PATIENCE_S):
        _, said = await process.communicate()
    assert process.returncode == 2
    assert said.decode().startswith(f"the bus at {endpoint} cannot be opened as client")
    assert said.count(b"\n") == 1


async def _started(settings):
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "drivers.aoa.simulated"),
        stdin=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    process.stdin.write(settings)
    process.stdin.close()
    return process
