"""The API tells the run as it is, in the schema it publishes, and nobody who reads slowly holds it up."""

from __future__ import annotations

import asyncio
import json
import re

import httpx
import jsonschema
import msgspec
import pytest
import uvicorn
import websockets
from prometheus_client.parser import text_string_to_metric_families
from starlette.websockets import WebSocketDisconnect

from drivers.bus.messages import encode
from drivers.bus.run_messages import Alert, Histogram, RunEvent, RunState
from gcs.monitor.client import LOST_S, RunClient
from gcs.monitor.metrics import live_socket
from gcs.monitor.metrics.api import api_app
from gcs.monitor.metrics.live_socket import LiveMessage, LiveSockets
from gcs.monitor.metrics.openapi import openapi
from gcs.monitor.state import StateTeller
from gcs.recording.bus_address import BusAddress
from gcs.relay.states import ReceiverState
from tests.fakes import ManualClock, settle
from tests.gcs.monitor.telling import ToldWorld, vehicle

KEY = "bearing-relay/paper-8/relay/@state"


@pytest.fixture(scope="module")
def flown() -> RunState:
    """The state of a run whose first receiver is on its second leg."""

    async def fly() -> RunState:
        world = ToldWorld()
        world.sources.vehicles = {"U1": vehicle("U1", world.clock)}
        task = asyncio.create_task(world.executor.run())
        while world.executor.records["U1"].state is not ReceiverState.LEG_2:
            world._measure()
            await world.clock.advance(0.1)
        for _ in range(10):
            world._measure()
            await world.clock.advance(0.1)
        state = StateTeller(world.sources).tell()
        task.cancel()
        return state

    return asyncio.run(fly())


class Api:
    """Asks the application, without a server."""

    def __init__(self, client: RunClient) -> None:
        self._app = api_app(client)

    def request(self, method: str, path: str) -> httpx.Response:
        async def ask() -> httpx.Response:
            async with httpx.AsyncClient(transport=httpx.ASGITransport(self._app), base_url="http://test") as http:
                return await http.request(method, path)

        return asyncio.run(ask())

    def get(self, path: str) -> httpx.Response:
        return self.request("GET", path)


@pytest.fixture
def client() -> RunClient:
    return RunClient(lambda: BusAddress("tcp/127.0.0.1:7447", "paper-8"), ManualClock())


@pytest.fixture
def api(client: RunClient) -> Api:
    return Api(client)


def heard(client: RunClient, state: RunState) -> None:
    client._take_state(KEY, encode(state))


def metrics(api: Api) -> dict[str, float]:
    """Return every sample by its name and labels."""
    text = api.get("/metrics").text
    return {
        sample.name + "".join(f" {name}={value}" for name, value in sorted(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def resolved(document: dict, reference: str) -> dict:
    for part in reference.removeprefix("#/").split("/"):
        document = document[part]
    return document


def test_before_a_run_is_heard_of_it_says_so(api: Api) -> None:
    for path in ("/api/v1/state", "/api/v1/setup", "/healthz"):
        answer = api.get(path)
        assert (answer.status_code, answer.json()["status"]) == (503, "lost")
    assert api.get("/api/v1/events").json() == {"events": []}
    assert metrics(api)["bearing_relay_up"] == 0.0


def test_the_state_is_told_as_it_came_and_is_what_the_document_says(api, client, flown: RunState) -> None:
    heard(client, flown)
    answer = api.get("/api/v1/state")
    assert answer.headers["content-type"] == "application/json"
    assert answer.headers["cache-control"] == "no-store"
    assert msgspec.json.decode(answer.content, type=RunState) == flown
    document = api.get("/api/v1/openapi.json").json()
    assert document == openapi()
    jsonschema.validate(answer.json(), {**document, "$ref": "#/components/schemas/RunState"})


def test_every_reference_of_the_document_leads_somewhere_and_every_path_is_served(api: Api) -> None:
    document = openapi()
    references = set(re.findall(r'"\$ref": "([^"]+)"', json.dumps(document)))
    assert len(references) > 15
    for reference in references:
        assert resolved(document, reference)["title"]
    routes = {path for path in document["paths"] if path != "/api/v1/live"}
    assert [api.get(path).status_code for path in sorted(routes)] == [200, 503, 503, 503, 200]


def test_events_from_a_number_on(api, client) -> None:
    client.events.extend(RunEvent("run-1", number, 0, 0.0, f"event {number}") for number in range(5))
    assert [each["text"] for each in api.get("/api/v1/events?first=3").json()["events"]] == ["event 3", "event 4"]
    assert api.get("/api/v1/events?first=-1").status_code == 422
    assert api.get("/api/v1/events?first=x").status_code == 422


def test_nothing_can_be_changed(api: Api) -> None:
    for path in openapi()["paths"]:
        assert {api.request(method, path).status_code for method in ("POST", "PUT", "DELETE")} <= {404, 405}


def test_health_is_lost_when_nothing_is_heard_any_more_unless_the_run_has_ended(api, client, flown) -> None:
    heard(client, flown)
    assert (api.get("/healthz").status_code, api.get("/healthz").json()["status"]) == (200, "ok")
    client.clock.jump(LOST_S + 1.0)
    answer = api.get("/healthz")
    assert (answer.status_code, answer.json()["status"]) == (503, "lost")
    assert "nothing heard of the run" in answer.json()["problem"]
    heard(client, msgspec.structs.replace(flown, phase="formed"))
    client.clock.jump(LOST_S + 1.0)
    assert (api.get("/healthz").status_code, api.get("/healthz").json()["status"]) == (200, "ended")


def test_the_metrics_are_those_of_the_state(api, client, flown: RunState) -> None:
    heard(client, msgspec.structs.replace(flown, alerts=[Alert("alert", "U1", "", "")] * 2))
    told, (receiver, *_), leg = metrics(api), flown.receivers, flown.receivers[0].leg
    assert told["bearing_relay_up"] == 1.0
    assert told["bearing_relay_receivers state=LEG_2"] == 1.0
    assert told["bearing_relay_receivers state=WAITING"] == 7.0
    assert told["bearing_relay_leg_remaining_metres receiver=U1"] == leg.remaining_m
    assert told["bearing_relay_leg_angle_radians receiver=U1"] == leg.angle_rad
    assert told["bearing_relay_bearing_reports_total receiver=U1"] == receiver.bearings.received > 0
    assert told["bearing_relay_vehicle_battery_percent vehicle=U1"] == 80.0
    assert told["bearing_relay_alerts level=alert"] == 2.0
    assert told["bearing_relay_to_go_seconds"] == flown.to_go_s
    assert told["bearing_relay_state_latency_seconds_count"] == 1.0
    assert "bearing_relay_leg_angle_radians receiver=U2" not in told


def test_the_decision_times_are_a_histogram(api, client, flown: RunState) -> None:
    heard(client, msgspec.structs.replace(flown, decisions=Histogram([0.1, 0.2], [3, 5, 6], 0.75)))
    told = metrics(api)
    assert told["bearing_relay_decision_seconds_bucket le=0.1"] == 3.0
    assert told["bearing_relay_decision_seconds_bucket le=+Inf"] == 6.0
    assert told["bearing_relay_decision_seconds_count"] == 6.0
    assert told["bearing_relay_decision_seconds_sum"] == 0.75


class SlowSocket:
    """A reader who takes a message only when he is told to."""

    def __init__(self) -> None:
        self.taken: list[dict] = []
        self.closed: list[int] = []
        self.reads = asyncio.Semaphore(0)
        self.leaves = asyncio.Event()

    async def accept(self) -> None:
        """Let him in."""

    async def close(self, code: int = 1000, reason: str = "") -> None:
        self.closed.append(code)

    async def send_text(self, text: str) -> None:
        await self.reads.acquire()
        self.taken.append(json.loads(text))

    async def receive_text(self) -> str:
        await self.leaves.wait()
        raise WebSocketDisconnect


async def test_the_live_socket_begins_with_what_is_known_and_tells_what_comes(client, flown: RunState) -> None:
    sockets, socket = LiveSockets(client), SlowSocket()
    socket.reads = asyncio.Semaphore(1000)
    client._take_setup(KEY, encode(ToldWorld().setup))
    client._add(RunEvent("run-1", 0, 0, 0.0, "before"))
    heard(client, flown)
    async with asyncio.TaskGroup() as group:
        group.create_task(sockets.serve(socket))
        await settle()
        heard(client, msgspec.structs.replace(flown, number=flown.number + 1))
        await settle()
        client._add(RunEvent("run-1", 1, 0, 0.0, "something"))
        await settle()
        socket.leaves.set()
    assert [list(message) for message in socket.taken] == [["setup"], ["event"], ["state"], ["state"], ["event"]]
    schema = {**openapi(), "$ref": "#/components/schemas/LiveMessage"}
    for message in socket.taken:
        jsonschema.validate(message, schema)
    assert socket.taken[3]["state"]["number"] == flown.number + 1
    assert socket.taken[4]["event"]["text"] == "something"


@pytest.mark.slow
async def test_over_a_real_server_the_live_socket_speaks_and_is_left(
    client, flown: RunState, caplog: pytest.LogCaptureFixture
) -> None:
    heard(client, flown)
    server = uvicorn.Server(uvicorn.Config(api_app(client), port=0, log_level="error", lifespan="off"))
    serving = asyncio.create_task(server.serve())
    while not server.started:  # noqa: ASYNC110 - uvicorn tells it no other way
        await asyncio.sleep(0.02)
    port = server.servers[0].sockets[0].getsockname()[1]
    async with websockets.connect(f"ws://127.0.0.1:{port}/api/v1/live") as socket:
        assert msgspec.json.decode(await socket.recv(), type=LiveMessage).state == flown
        await socket.send(b"\x00 binary, which nobody understands")
    async with websockets.connect(f"ws://127.0.0.1:{port}/api/v1/live") as socket:
        await socket.recv()
        socket.transport.abort()  # gone without a word, while there is something to be said
        heard(client, msgspec.structs.replace(flown, number=flown.number + 1))
        async with asyncio.timeout(10.0):
            while server.server_state.connections or server.server_state.tasks:  # noqa: ASYNC110 - as above
                await asyncio.sleep(0.02)
    server.should_exit = True
    await serving
    assert "Exception" not in caplog.text


async def test_who_reads_slowly_gets_the_latest_state_and_holds_nobody_up(client, flown: RunState) -> None:
    sockets, slow, quick = LiveSockets(client), SlowSocket(), SlowSocket()
    quick.reads = asyncio.Semaphore(1000)
    async with asyncio.TaskGroup() as group:
        for socket in (slow, quick):
            group.create_task(sockets.serve(socket))
        for number in range(100):
            heard(client, msgspec.structs.replace(flown, number=number))
            await asyncio.sleep(0)
        for _ in range(2):
            slow.reads.release()
            await settle()
        assert [message["state"]["number"] for message in slow.taken][-1] == 99
        assert len(slow.taken) == 2
        assert quick.taken[-1]["state"]["number"] == 99
        slow.leaves.set()
        quick.leaves.set()
    assert sockets._outboxes == []


async def test_who_reads_nothing_is_closed(client, flown: RunState, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_socket, "STUCK_S", 0.01)
    sockets, stuck = LiveSockets(client), SlowSocket()
    heard(client, flown)
    await asyncio.wait_for(sockets.serve(stuck), 5.0)
    assert stuck.closed
    assert sockets._outboxes == []


async def test_not_more_than_so_many_are_let_in(client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_socket, "MOST", 0)
    refused = SlowSocket()
    await LiveSockets(client).serve(refused)
    assert refused.closed == [1013]
