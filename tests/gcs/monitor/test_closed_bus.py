"""Screens on a bus that is closed to strangers: the operator's keys let them in, and without any they say why not."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest

from drivers.bus.certificates import Authority, now
from drivers.bus.messages import ControlReply, ControlRequest, encode
from drivers.bus.security import configurations, with_keys
from drivers.bus.session import BusEndpoint, open_bus
from drivers.errors import BusError
from drivers.simulation.launcher import free_tcp_port
from gcs.commands import dashboard, monitor
from gcs.errors import ServiceError
from gcs.monitor.client import following, joining
from gcs.monitor.publisher import published
from gcs.monitor.terminal_app import app
from gcs.monitor.web import server
from gcs.recording.bus_address import BusAddress
from tests.gcs.monitor.telling import ToldWorld
from tests.gcs.monitor.test_client import until

SWARM = "paper-8"


@pytest.fixture
def closed(tmp_path: Path) -> str:
    """Make a file for every party beside each other, and return the endpoint of their router."""
    endpoint = f"tls/127.0.0.1:{free_tcp_port()}"
    for party, keys in configurations(SWARM, ["U1"], endpoint, Authority(SWARM, now(), valid_days=2)).items():
        (tmp_path / party).write_text(keys)
        (tmp_path / party).chmod(0o600)
    return endpoint


@contextlib.asynccontextmanager
async def told(folder: Path, endpoint: str):
    """Open the router and tell a run over it, as the service does."""
    world = ToldWorld()
    router = with_keys(BusEndpoint(endpoint, "router"), folder / "router")
    service = with_keys(BusEndpoint(endpoint), folder / "service")
    async with open_bus(router), open_bus(service) as bus, published(bus, world.keys, world.sources):
        bus.serve(world.keys.control, lambda _: encode(ControlReply(ok=True, message="the relay is held")))
        yield world


@pytest.mark.slow
async def test_with_the_operator_s_keys_a_screen_sees_and_commands_and_without_it_says_what_is_missing(
    tmp_path: Path, closed: str
) -> None:
    def find() -> BusAddress:
        return BusAddress(closed, "")

    async with told(tmp_path, closed) as world:
        world.status.say("before the screen")
        async with following(find, join=joining(tmp_path / "operator")) as client, following(find) as stranger:
            await until(lambda: client.state is not None and client.setup == world.setup and len(client.events) == 1)
            assert (await client.command(ControlRequest("hold"))).message == "the relay is held"
            await until(lambda: "give --keys" in (stranger.problem or ""))
            assert stranger.state is None


def test_both_commands_join_with_them(tmp_path: Path, closed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    joins = []

    async def show(client, *, commands) -> None:
        joins.append(client.open_bus)

    async def serve(*_, join, **__) -> None:
        joins.append(join)

    monkeypatch.setattr(app, "show", show)
    monkeypatch.setattr(server, "serve", serve)
    monitor.monitor(connect=closed, keys=tmp_path / "operator")
    dashboard.dashboard(connect=closed, keys=tmp_path / "operator")
    assert len(joins) == 2
    for join in joins:
        with pytest.raises(ServiceError, match="without --keys"):
            join(BusEndpoint("tcp/127.0.0.1:7447"))


def test_keys_that_are_no_good_are_refused_at_once(tmp_path: Path, closed: str) -> None:
    with pytest.raises(BusError, match="cannot be read"):
        joining(tmp_path / "none")
    with pytest.raises(BusError, match="those of a client are needed"):
        joining(tmp_path / "router")
    (tmp_path / "operator").chmod(0o644)
    with pytest.raises(BusError, match="chmod 600"):
        joining(tmp_path / "operator")


async def test_an_open_bus_is_not_joined_with_keys_and_that_is_said(tmp_path: Path, closed: str) -> None:
    address = BusAddress("tcp/127.0.0.1:7447", SWARM)
    async with following(lambda: address, join=joining(tmp_path / "operator")) as client:
        await until(lambda: "without --keys" in (client.problem or ""))
