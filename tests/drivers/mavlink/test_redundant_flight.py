"""An embedded copter flown over two UDP links, each through a network that can be cut or can hold packets back."""

import asyncio
import contextlib
import itertools
import time

import pytest

from drivers.clock import SystemClock
from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.codec import Codec, FrameSplitter
from drivers.mavlink.link import open_link
from drivers.mavlink.redundant import RedundantLink
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits, StreamState
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import CopterSpec, SimulatedTime, process_group, this_pid
from planner.frames import GeodeticPosition

pytestmark = pytest.mark.slow

LOOPBACK = "127.0.0.1"
HOME = GeodeticPosition(47.4, 8.5, 430.0)
SETPOINT_ID = 84
HEIGHT_M = 2.0


class Network(asyncio.DatagramProtocol):
    """Carries datagrams between a copter and a ground station, and notes each setpoint that arrives at the copter."""

    def __init__(self, ground_port):
        self.setpoints = []
        self.is_cut = False
        self.holds_back = False
        self._ground = (LOOPBACK, ground_port)
        self._copter = None
        self._held = []
        self._splitter = FrameSplitter()

    def connection_made(self, transport):
        self._transport = transport

    @property
    def port(self):
        return self._transport.get_extra_info("sockname")[1]

    def datagram_received(self, data, source):
        if source != self._ground:
            self._copter = source
        if self.holds_back:
            self._held.append((data, source))
        elif not self.is_cut:
            self._carry(data, source)

    def release(self):
        """Deliver all that was held back, in order."""
        self.holds_back = False
        for data, source in self._held:
            self._carry(data, source)
        self._held.clear()

    def _carry(self, data, source):
        if source != self._ground:
            self._transport.sendto(data, self._ground)
            return
        self._transport.sendto(data, self._copter)
        frames = self._splitter.datagram(data)
        self.setpoints += [time.monotonic() for frame in frames if frame[7] == SETPOINT_ID]


class Flight:
    """A copter that hovers, its two links, the first preferred, and its setpoint stream."""

    def __init__(self, vehicle, stream, networks):
        self.vehicle, self.stream, self.networks = vehicle, stream, networks
        self.stalls = []
        """(from, to), monotonic, s: when nothing in this process ran, the stream no more than this."""

    @property
    def speed_mps(self):
        return abs(complex(*self.vehicle.telemetry.kinematics.velocity_ned_mps[:2]))

    async def look_for_stalls(self):
        while True:
            due_s = time.monotonic() + 0.01
            await asyncio.sleep(0.01)
            self.stalls.append((due_s, time.monotonic()))

    async def fly(self, duration_s):
        """Renew the lease for a while; return the slowest that the copter was."""
        slowest_mps = self.speed_mps
        for _ in range(round(duration_s / 0.1)):
            self.stream.renew(3 + 0j)
            await asyncio.sleep(0.1)
            slowest_mps = min(slowest_mps, self.speed_mps)
        return slowest_mps

    def longest_gap_s(self, since_s):
        """The longest time without a setpoint at the copter, s, in which this process ran."""
        arrived = sorted(t for network in self.networks for t in network.setpoints if t >= since_s)

        def stalled_s(earlier, later):
            return sum(max(0.0, min(later, end) - max(earlier, begin)) for begin, end in self.stalls)

        return max(later - earlier - stalled_s(earlier, later) for earlier, later in itertools.pairwise(arrived))


@pytest.fixture
async def flight(tmp_path):
    clock, loop = SystemClock(), asyncio.get_running_loop()
    async with contextlib.AsyncExitStack() as stack:
        links, networks = [], []
        for _ in range(2):
            address = LinkAddress("udpin", LOOPBACK, 0)
            links.append(await stack.enter_async_context(open_link(address, Codec(), clock)))
            transport, network = await loop.create_datagram_endpoint(
                lambda: Network(links[-1].address.port), local_addr=(LOOPBACK, 0)
            )
            stack.callback(transport.close)
            networks.append(network)
        vehicle = Vehicle("U1", 1, RedundantLink(1, links, clock), clock)
        group = await stack.enter_async_context(process_group(tmp_path))
        copter = CopterSpec("U1", 1, networks[0].port, HOME).arguments(SimulatedTime(1.0, time.time_ns()), this_pid())
        second = ["--link", f"udpout:{LOOPBACK}:{networks[1].port}"]
        await group.start("U1", [*copter, *second])
        await vehicle.wait_until(lambda: vehicle.telemetry.heartbeat is not None, 20.0, "heartbeat", "")
        autopilot = ArduCopter()
        await autopilot.prepare(vehicle)
        await autopilot.take_off(vehicle, HEIGHT_M)
        stream = SetpointStreamer(vehicle, autopilot, HEIGHT_M, StreamLimits(), clock)
        flight = Flight(vehicle, stream, networks)
        runners = [asyncio.create_task(running) for running in (stream.run(), flight.look_for_stalls())]
        try:
            yield flight
        finally:
            for runner in runners:
                runner.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await runner


async def test_a_cut_of_the_preferred_link_leaves_no_gap_in_the_stream_and_the_copter_flies_on(flight):
    await flight.fly(3.0)
    cut_s = time.monotonic()
    flight.networks[0].is_cut = True
    slowest_mps = await flight.fly(3.0)
    assert flight.longest_gap_s(cut_s - 0.5) < 0.5
    assert slowest_mps > 2.0
    assert len(flight.networks[1].setpoints) > 20
    assert flight.stream.state is StreamState.LEASED
    async with asyncio.timeout(20.0):
        while flight.vehicle.silent_for_s() > 0.5:
            await flight.fly(0.1)


async def test_motion_that_lay_in_the_link_left_does_not_set_a_stopped_copter_going_again(flight):
    await flight.fly(3.0)
    flight.networks[0].holds_back = True
    await flight.fly(2.0)
    flight.stream.stop()
    async with asyncio.timeout(20.0):
        while flight.stream.state is not StreamState.SILENT or flight.speed_mps > 0.1:  # noqa: ASYNC110 - no event tells
            await asyncio.sleep(0.05)
    before = len(flight.networks[0].setpoints)
    flight.networks[0].release()
    fastest_mps = 0.0
    for _ in range(30):
        await asyncio.sleep(0.1)
        fastest_mps = max(fastest_mps, flight.speed_mps)
    assert len(flight.networks[0].setpoints) > before, "nothing old was in the link"
    assert fastest_mps < 0.5
