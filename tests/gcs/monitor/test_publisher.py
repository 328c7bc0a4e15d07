"""A run is put before its screens a few times a second and at once when something happens; no screen holds it up."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.messages import encode
from drivers.bus.run_messages import EVENTS_KEPT, Events, EventsRequest, RunEvent, RunSetup, RunState, decode_run
from drivers.bus.session import Bus
from gcs.monitor.publisher import PERIOD_S, SHORTEST_S, published
from tests.fakes import FakeBus, ManualClock
from tests.gcs.monitor.telling import ToldWorld, vehicle


@pytest.fixture
def world() -> ToldWorld:
    return ToldWorld(uavs=8)


@contextlib.asynccontextmanager
async def told(world: ToldWorld, bus: Bus | None = None) -> AsyncIterator[ManualClock]:
    pace = ManualClock()
    async with published(bus or world.bus, world.keys, world.sources, pace):
        yield pace


def states(world: ToldWorld) -> list[RunState]:
    return [decode_run(payload, RunState) for payload in world.bus.payloads(world.keys.state)]


def events(world: ToldWorld) -> list[RunEvent]:
    return [decode_run(payload, RunEvent) for payload in world.bus.payloads(world.keys.events)]


async def asked(world: ToldWorld, first: int = 0) -> list[RunEvent]:
    return decode_run(await world.bus.ask(world.keys.events, encode(EventsRequest(first))), Events).events


async def test_a_quiet_run_is_told_five_times_a_second(world: ToldWorld) -> None:
    async with told(world) as pace:
        await pace.advance(10.0)
        assert len(states(world)) == pytest.approx(10.0 / PERIOD_S, abs=2)


async def test_what_happens_is_told_at_once(world: ToldWorld) -> None:
    async with told(world) as pace:
        await pace.advance(10.0 + SHORTEST_S)
        before = len(states(world))
        world.status.phase = "landing"
        world.status.say("something")
        await pace.advance(SHORTEST_S)
        assert len(states(world)) == before + 1
        assert states(world)[-1].phase == "landing"


async def test_however_much_happens_states_are_told_twenty_times_a_second_at_most(world: ToldWorld) -> None:
    async with told(world) as pace:
        for _ in range(1000):
            world.status.say("something")
            await pace.advance(0.001)
        assert len(states(world)) <= 1.0 / SHORTEST_S + 1
        assert len(events(world)) == 1000


async def test_nothing_but_the_setup_is_put_so_that_it_waits_for_anybody(world: ToldWorld) -> None:
    async with told(world) as pace:
        world.status.say("something")
        await pace.advance(1.0)
    assert world.bus.reliable_keys == {world.keys.setup}


async def test_the_setup_is_told_once_and_can_be_fetched(world: ToldWorld) -> None:
    async with told(world) as pace:
        await pace.advance(1.0)
        fetched = await world.bus.fetch(world.keys.setup)
        assert decode_run(fetched[world.keys.setup], RunSetup) == world.setup
    assert len(world.bus.payloads(world.keys.setup)) == 1


async def test_events_are_numbered_as_the_states_count_them(world: ToldWorld) -> None:
    world.status.say("before anybody could hear it")
    async with told(world) as pace:
        world.status.say("U1 LEG_1", vehicle="U1", leg=1, state="LEG_1")
        world.status.say("careful", level="warning")
        await pace.advance(1.0)
    first, second = events(world)
    assert (first.number, first.vehicle, first.leg, first.state, first.level) == (1, "U1", 1, "LEG_1", "info")
    assert (second.number, second.text, second.level, second.vehicle) == (2, "careful", "warning", None)
    assert states(world)[-1].events == 3


async def test_events_can_be_asked_for_later_from_any_number_on(world: ToldWorld) -> None:
    async with told(world):
        for number in range(5):
            world.status.say(f"event {number}")
        assert [event.text for event in await asked(world, 3)] == ["event 3", "event 4"]
        assert await asked(world) == events(world)
        assert await asked(world, 99) == []
        answer = await world.bus.ask(world.keys.events, b"no request")
        assert decode_run(answer, Events).events == events(world)


async def test_only_the_last_events_are_kept(world: ToldWorld) -> None:
    async with told(world):
        for _ in range(EVENTS_KEPT + 10):
            world.status.say("something")
        kept = await asked(world)
    assert (len(kept), kept[0].number) == (EVENTS_KEPT, 10)


class DeadBus(FakeBus):
    """Fails whatever it is told to publish as a latest value."""

    def put_latest(self, key, payload, *, urgent=False) -> None:
        raise RuntimeError("the session has closed")


async def test_a_bus_that_fails_ends_no_flight(world: ToldWorld, caplog: pytest.LogCaptureFixture) -> None:
    async with told(world, DeadBus()) as pace:
        world.status.say("something")
        await pace.advance(10.0)
    assert caplog.text.count("the flight goes on") == 1
    assert world.status.said == 1


async def test_a_state_that_cannot_be_told_ends_no_flight(world: ToldWorld, caplog: pytest.LogCaptureFixture) -> None:
    def broken() -> list:
        raise ValueError("no such link")

    world.status.links = broken
    async with told(world) as pace:
        await pace.advance(1.0)
        world.status.links = tuple
        await pace.advance(1.0)
        assert len(states(world)) > 3
    assert "no such link" in caplog.text


async def test_when_the_run_ends_its_last_state_is_told_and_nothing_more(world: ToldWorld) -> None:
    async with told(world) as pace:
        await pace.advance(1.0)
        world.status.phase = "formed"
    count = len(world.bus.sent)
    world.status.say("after the end")
    await asyncio.sleep(0)
    assert states(world)[-1].phase == "formed"
    assert len(world.bus.sent) == count


async def test_headings_are_those_that_vehicles_tell(world: ToldWorld) -> None:
    made = vehicle("U1", world.clock)
    world.sources.vehicles = {"U1": made}
    async with told(world) as pace:
        for hdg in (9_000, 65_535):  # the latter: not known
            message = mavlink.MAVLink_global_position_int_message(1, 0, 0, 0, 0, 0, 0, 0, hdg)
            made._receive(message)
        await pace.advance(1.0)
        east = world.frame.azimuth_rad(1.5707963267948966)
        assert states(world)[-1].vehicles[0].heading_rad == pytest.approx(east)
