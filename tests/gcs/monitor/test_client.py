"""A screen knows the latest state of the run, all its events in order, and finds the run again when it was lost."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

import msgspec
import pytest

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import ControlReply, ControlRequest, decode, encode
from drivers.bus.run_messages import RunEvent, RunState
from drivers.bus.session import BusEndpoint
from drivers.errors import BusError
from drivers.simulation.launcher import process_group
from drivers.tasks import background
from gcs.errors import ServiceError
from gcs.monitor.client import LOOK_S, LOST_S, RunClient, following
from gcs.monitor.history import Span
from gcs.monitor.publisher import published
from gcs.recording.bus_address import BusAddress
from gcs.relay.states import ReceiverState
from gcs.run_bus import joined, start_router
from tests.fakes import FakeBus, ManualClock
from tests.gcs.monitor.telling import ToldWorld

ADDRESS = BusAddress("tcp/127.0.0.1:7447", "paper-8")


class Seen:
    """A client on a bus in memory; `find` answers what a test says."""

    def __init__(self) -> None:
        self.clock, self.bus, self.address = ManualClock(), FakeBus(), ADDRESS
        self.opened: list[BusEndpoint] = []
        self.client = RunClient(self.find, self.clock, self.open_bus)

    def find(self) -> BusAddress:
        if self.address is None:
            raise ServiceError("no run has a bus")
        return self.address

    def open_bus(self, endpoint: BusEndpoint):
        self.opened.append(endpoint)
        return contextlib.nullcontext(self.bus)

    async def advance(self, duration_s: float = 2 * LOOK_S) -> None:
        await self.clock.advance(duration_s)


@pytest.fixture
async def seen() -> AsyncIterator[Seen]:
    seen = Seen()
    task = asyncio.create_task(seen.client.follow())
    await seen.advance(0.0)
    yield seen
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


@contextlib.asynccontextmanager
async def told(seen: Seen, world: ToldWorld) -> AsyncIterator[ManualClock]:
    pace = ManualClock()
    async with published(seen.bus, world.keys, world.sources, pace):
        await pace.advance(0.0)
        yield pace


async def test_the_latest_state_counts(seen: Seen) -> None:
    world, heard = ToldWorld(), []
    seen.client.on_state.append(heard.append)
    async with told(seen, world) as pace:
        world.status.phase = "landing"
        await pace.advance(1.0)
    assert (seen.client.state.phase, seen.client.lost) == ("landing", False)
    assert heard[-1] is seen.client.state
    numbers = [state.number for state in heard]
    assert numbers == sorted(numbers)


async def test_a_state_overtaken_on_its_way_is_not_shown(seen: Seen) -> None:
    for number in (5, 4):
        state = RunState("run-1", number, 0, 0, f"phase {number}", 1.0)
        seen.bus.put_latest(SwarmKeys("paper-8").state, encode(state))
    assert seen.client.state.number == 5


async def test_who_attaches_late_gets_setup_and_all_events_in_order() -> None:
    seen, world = Seen(), ToldWorld()
    async with told(seen, world) as pace:
        for number in range(5):
            world.status.say(f"event {number}")
        async with background(seen.client.follow()):
            await seen.advance()
            assert seen.client.state is None
            await pace.advance(1.0)
            await seen.advance()
            assert seen.client.setup == world.setup
            assert [event.number for event in seen.client.events] == [0, 1, 2, 3, 4]
            world.status.say("event 5")
            assert seen.client.events[-1].text == "event 5"


async def test_events_that_were_dropped_are_asked_for_and_none_comes_twice(seen: Seen) -> None:
    world, heard = ToldWorld(), []
    seen.client.on_event.append(heard.append)
    async with told(seen, world) as pace:
        world.status.say("event 0")
        seen.bus.up = False
        world.status.say("event 1")
        seen.bus.up = True
        world.status.say("event 2")
        assert [event.number for event in heard] == [0]
        await pace.advance(1.0)
        await seen.advance()
        world.status.say("event 3")
    assert [event.number for event in heard] == [0, 1, 2, 3]
    assert [event.number for event in seen.client.events] == [0, 1, 2, 3]


async def test_what_is_old_is_said_to_be_old_above_all(seen: Seen) -> None:
    assert seen.client.alerts()[0].subject == "service"
    world = ToldWorld()
    async with told(seen, world):
        assert seen.client.alerts() == []
        await seen.advance(LOST_S + 1.0)
        alert = seen.client.alerts()[0]
        assert (alert.level, alert.subject) == ("alert", "service")
        assert "for 3 s" in alert.text
        assert seen.client.state is not None


async def test_a_run_that_has_ended_is_not_missed(seen: Seen) -> None:
    world = ToldWorld()
    async with told(seen, world):
        world.status.phase = "formed"
    await seen.advance(LOST_S + 1.0)
    assert [(alert.level, alert.text) for alert in seen.client.alerts()] == [("info", "it has ended")]


async def test_a_plan_made_anew_is_fetched(seen: Seen) -> None:
    world = ToldWorld()
    async with told(seen, world) as pace:
        await seen.advance()
        assert seen.client.setup == world.setup
        again = msgspec.structs.replace(world.setup, number=1, routes=world.setup.routes[:1])
        world.sources.plan_setup = lambda: again
        await pace.advance(1.0)
        await seen.advance()
        assert seen.client.setup == again
    assert len(seen.bus.payloads(SwarmKeys("paper-8").setup)) == 2


async def test_another_run_begins_anew(seen: Seen) -> None:
    async with told(seen, world := ToldWorld()) as pace:
        world.status.say("old", vehicle="U1", state="LOCATING")
        await pace.advance(1.0)
        await seen.advance()
    second = ToldWorld()
    second.sources.setup = msgspec.structs.replace(second.setup, run="run-2")
    async with told(seen, second) as pace:
        second.status.say("new")
        await pace.advance(1.0)
        await seen.advance()
        assert seen.client.setup.run == "run-2"
        assert [event.text for event in seen.client.events] == ["new"]
        assert seen.client.history.spans("U1") == [Span("WAITING", 0.0)]


async def test_a_run_that_moved_is_followed_and_one_that_is_not_there_is_looked_for(seen: Seen) -> None:
    seen.address = None
    await seen.advance()
    assert "no run has a bus" in seen.client.problem
    assert first_problem(seen) == "no run has a bus"
    seen.address = BusAddress("tcp/127.0.0.1:9999", "paper-8")
    await seen.advance(3 * LOOK_S)
    assert seen.opened[-1].endpoint == "tcp/127.0.0.1:9999"
    assert seen.client.problem is None


def first_problem(seen: Seen) -> str:
    return seen.client.alerts()[0].way_out


async def test_without_the_swarm_s_name_the_only_one_on_the_bus_is_taken() -> None:
    seen, world = Seen(), ToldWorld()
    seen.address = BusAddress("tcp/127.0.0.1:7447", "")
    async with background(seen.client.follow()):
        await seen.advance()
        assert "no run is on this bus" in seen.client.problem
        async with told(seen, world) as pace:
            await seen.advance(3 * LOOK_S)
            await pace.advance(1.0)
            assert seen.client.state is not None
            assert seen.client.address.swarm == "paper-8"
            seen.bus.put_reliably(SwarmKeys("another").setup, encode(world.setup))
    seen = restarted(seen)
    async with background(seen.client.follow()):
        await seen.advance()
        assert "2 runs are on this bus (another, paper-8): choose one with --swarm" in seen.client.problem


def restarted(seen: Seen) -> Seen:
    again = Seen()
    again.bus, again.address = seen.bus, seen.address
    return again


async def test_a_bus_that_cannot_be_opened_is_tried_again(seen: Seen) -> None:
    def refuse(endpoint: BusEndpoint):
        raise BusError("a long story of another library")

    seen.client.open_bus, opened = refuse, seen.client.open_bus
    seen.address = BusAddress("tcp/127.0.0.1:1", "paper-8")
    await seen.advance(3 * LOOK_S)
    assert seen.client.problem.startswith("the bus at tcp/127.0.0.1:1 cannot be reached")
    seen.client.open_bus = opened
    await seen.advance(3 * LOOK_S)
    assert seen.client.problem is None


async def test_a_router_that_is_gone_is_tried_again(seen: Seen) -> None:
    seen.bus.up = False
    await seen.advance()
    assert "tried again" in seen.client.problem
    opened = len(seen.opened)
    seen.bus.up = True
    await seen.advance(3 * LOOK_S)
    assert len(seen.opened) > opened
    assert seen.client.problem is None


async def test_garbage_is_counted_and_what_was_known_stays(seen: Seen) -> None:
    async with told(seen, ToldWorld()):
        keys = SwarmKeys("paper-8")
        for key in (keys.state, keys.events):
            seen.bus.put_latest(key, b'{"run": 5}')
        assert seen.client.malformed == 2
        assert seen.client.state.phase == "relay"


async def test_a_field_of_another_version_is_passed_over(seen: Seen) -> None:
    payload = encode(RunState("run-1", 0, 0, 0, "relay", 1.0))[:-1] + b',"invented_later":1}'
    seen.bus.put_latest(SwarmKeys("paper-8").state, payload)
    assert seen.client.state.phase == "relay"


async def test_the_operator_s_word_is_answered(seen: Seen) -> None:
    def answer(payload: bytes) -> bytes:
        return encode(ControlReply(ok=True, message=decode(payload, ControlRequest).verb))

    with pytest.raises(BusError):
        await seen.client.command(ControlRequest("hold"))
    seen.bus.serve(SwarmKeys("paper-8").control, answer)
    assert await seen.client.command(ControlRequest("hold")) == ControlReply(ok=True, message="hold")
    seen.bus.serve(SwarmKeys("paper-8").control, lambda _: b"what?")
    with pytest.raises(BusError, match="something else"):
        await seen.client.command(ControlRequest("hold"))


async def test_without_a_bus_no_word_is_said() -> None:
    with pytest.raises(BusError, match="looking for the run"):
        await Seen().client.command(ControlRequest("abort"))


async def test_the_past_of_a_whole_relay(seen: Seen) -> None:
    """Spans are the states as flown, and angles end at the stop angles."""
    world = ToldWorld()
    async with published(seen.bus, world.keys, world.sources, world.clock):
        await world.run()
        await seen.advance()
    history, record = seen.client.history, world.executor.records["U3"]
    flown = [state.value for _, name, state, _ in world.history if name == "U3"]
    assert [span.state for span in history.spans("U3")] == ["WAITING", *dict.fromkeys(flown)]
    assert record.state is ReceiverState.PLACED
    assert history.spans("U3")[-1].to_s is None
    spans = history.spans("U3")
    assert [span.to_s for span in spans[:-1]] == [span.from_s for span in spans[1:]]
    assert history.tracks == {}  # no vehicle of this world speaks
    last = history.angles["U3"][-1]
    assert last.angle_rad == pytest.approx(last.stop_angle_rad, abs=0.02)


async def test_a_late_event_finds_its_place_in_the_past() -> None:
    client = Seen().client
    client.history.note(RunEvent("run-1", 3, 0, 9.0, "", vehicle="U1", state="LEG_2"))
    client.history.note(RunEvent("run-1", 2, 0, 4.0, "", vehicle="U1", state="LEG_1"))
    client.history.note(RunEvent("run-1", 4, 0, 9.5, "slow", vehicle="U1", state="LEG_2"))
    assert client.history.spans("U1") == [Span("LEG_1", 4.0, 9.0), Span("LEG_2", 9.0)]


@pytest.mark.slow
async def test_over_a_real_bus_a_screen_that_attaches_late_sees_the_run(tmp_path) -> None:
    world = ToldWorld()
    async with process_group(tmp_path) as group:
        address = BusAddress(await start_router(group), "paper-8")
        async with joined(address.endpoint) as bus, published(bus, world.keys, world.sources):
            world.status.say("before the screen", vehicle="U1", state="LOCATING")
            async with following(lambda: address) as client:
                await until(lambda: client.setup == world.setup and len(client.events) == 1)
                assert len(client.state.receivers) == 8
                world.status.phase = "landing"
                world.status.say("while it looks")
                await until(lambda: client.state.phase == "landing" and len(client.events) == 2)


async def until(condition, within_s: float = 10.0) -> None:
    async with asyncio.timeout(within_s):
        while not condition():  # noqa: ASYNC110 - a process beside this one is waited for
            await asyncio.sleep(0.02)
