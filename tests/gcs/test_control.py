"""The operator's word from the command line over a real bus to a relay, and the answer back."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import typer
from click.testing import Result
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from drivers.bus.messages import ControlReply, ControlRequest, decode, encode
from drivers.bus.session import Bus
from drivers.errors import BusError
from drivers.simulation.launcher import free_tcp_port, process_group
from gcs.commands.control import control
from gcs.control import ControlDesk
from gcs.errors import ServiceError
from gcs.recording.bus_address import address_of, newest_run
from gcs.relay.states import ReceiverState
from gcs.run_bus import joined, start_router
from tests.fakes import FakeBus
from tests.gcs.relay.operating import step
from tests.gcs.relay.world import World

app = typer.Typer()
app.command()(control)


def test_a_request_is_answered_counted_and_put_before_whoever_watches() -> None:
    world = World(attended=True)
    desk = ControlDesk(world.executor, world.said.append)
    assert decode(desk.answer(b'{"verb":"hold"}'), ControlReply).ok
    assert not decode(desk.answer(b'{"verb":"release","vehicle":"U1"}'), ControlReply).ok
    assert (desk.done, desk.refused, desk.malformed) == (1, 1, 0)
    assert world.said[-2] == "operator: hold: the relay is held; stopped: nobody"
    assert world.said[-1].startswith("operator: release U1: ")


@settings(max_examples=30)
@given(st.binary(max_size=60) | st.sampled_from([b'{"verb":"fly"}', b'{"verb":"hold","force":true}', b"null"]))
def test_whatever_comes_is_answered_and_what_is_no_request_does_nothing(payload: bytes) -> None:
    world = World(attended=True)
    desk = ControlDesk(world.executor, world.said.append)
    reply = decode(desk.answer(payload), ControlReply)
    assert not reply.ok
    assert "no control request" in reply.message
    assert desk.malformed == 1
    assert world.executor.held is None


async def test_a_desk_on_the_bus_serves_its_own_swarm_alone() -> None:
    world, bus = World(attended=True), FakeBus()
    bus.serve(world.keys.control, ControlDesk(world.executor, world.said.append).answer)
    reply = await bus.ask(world.keys.control, encode(ControlRequest("hold")))
    assert decode(reply, ControlReply).ok
    with pytest.raises(BusError):
        await bus.ask("bearing-relay/other/relay/control", encode(ControlRequest("hold")))


@contextlib.asynccontextmanager
async def opened(folder: Path) -> AsyncIterator[tuple[Bus, Path]]:
    """Open a real bus, and a runs folder whose newest run is on it."""
    run = folder / "runs" / "20261101T120000-paper-8"
    run.mkdir(parents=True)
    async with process_group(folder) as group:
        endpoint = await start_router(group)
        async with joined(endpoint) as bus:
            (run / "bus.json").write_text(json.dumps({"endpoint": endpoint, "swarm": "paper-8"}))
            yield bus, run


async def typed(*words: str) -> Result:
    """Type a command in a process's own thread, as the operator beside the service does."""
    return await asyncio.to_thread(CliRunner().invoke, app, list(words))


@pytest.mark.slow
async def test_typed_words_hold_and_resume_a_relay_that_forms(tmp_path: Path) -> None:
    world = World(sigma_deg=0.1, attended=True)
    async with opened(tmp_path) as (bus, run):
        desk = ControlDesk(world.executor, world.said.append)
        bus.serve(world.keys.control, desk.answer)
        in_runs = ("--runs-dir", str(run.parent))
        relay = asyncio.create_task(world.executor.run())
        while world.states()["U2"] is not ReceiverState.LEG_1:
            await step(world)
        held = await typed("hold", *in_runs)
        assert (held.exit_code, held.output) == (0, "the relay is held; stopped: U2\n")
        assert world.states()["U2"] is ReceiverState.HELD
        world.vehicles["U3"].take_over()
        refused = await typed("resume", "--run", str(run))
        assert refused.exit_code == 1
        assert "release U3" in refused.output
        world.vehicles["U3"].guided = True
        address = json.loads((run / "bus.json").read_text())
        named = ("--connect", address["endpoint"], "--swarm", address["swarm"])
        assert (await typed("release", "U3", *named)).exit_code == 0
        assert (await typed("resume", *in_runs)).exit_code == 0
        assert (await typed("fly", *in_runs)).exit_code == 2
        while not relay.done():
            await step(world)
        await relay
        assert (desk.done, desk.refused) == (3, 1)
    assert world.executor.formed


@pytest.mark.slow
async def test_a_relay_that_cannot_be_reached_is_an_error_that_says_where_it_was_looked_for(tmp_path: Path) -> None:
    async with opened(tmp_path) as (bus, run):
        nobody = await typed("hold", "--runs-dir", str(run.parent))
        assert isinstance(nobody.exception, BusError)
        assert "bearing-relay/paper-8/relay/control is not answered" in str(nobody.exception)
        bus.serve("bearing-relay/paper-8/relay/control", lambda _: b"hello")
        while isinstance((other := await typed("hold", "--run", str(run))).exception, BusError):
            if "something else than this service" in str(other.exception):
                break
    no_router = await typed("hold", "--connect", f"tcp/127.0.0.1:{free_tcp_port()}", "--swarm", "paper-8")
    assert isinstance(no_router.exception, BusError)
    every_swarm = await typed("hold", "--run", str(run), "--swarm", "*")
    assert isinstance(every_swarm.exception, ServiceError)


def test_the_newest_run_is_found_and_a_run_without_a_bus_is_named(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match=f"no run in {tmp_path}"):
        newest_run(tmp_path)
    for number, name in enumerate(("20261101T120000-b", "20261101T130000-a")):
        (tmp_path / name).mkdir()
        path = tmp_path / name / "bus.json"
        path.write_text(json.dumps({"endpoint": f"tcp/127.0.0.1:{7447 + number}", "swarm": name[-1]}))
        os.utime(path, (1_000.0 - number, 1_000.0 - number))
    (tmp_path / "20261101T140000-planned").mkdir()
    newest = newest_run(tmp_path)
    assert newest.name == "20261101T120000-b"
    assert address_of(newest).endpoint == "tcp/127.0.0.1:7447"
    with pytest.raises(ServiceError, match="planned"):
        address_of(tmp_path / "20261101T140000-planned")
    (newest / "bus.json").write_text('{"endpoint": 7447}')
    with pytest.raises(ServiceError, match=r"bus\.json is no address"):
        address_of(newest)
