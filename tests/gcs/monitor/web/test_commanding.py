"""The operator's word from the page: what reaches the relay, and what is answered when it cannot."""

import json
from types import SimpleNamespace

import httpx
import pytest
from starlette.applications import Starlette
from starlette.routing import Route

from drivers.bus.messages import ControlReply, ControlRequest
from drivers.errors import BusError
from gcs.monitor.access import Role
from gcs.monitor.web.commanding import have_a_word
from gcs.monitor.web.gate import Visitor


class Relay:
    """Notes what it is asked and answers with what it was given."""

    def __init__(self, answer):
        self.answer = answer
        self.asked = []

    async def command(self, request):
        self.asked.append(request)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


async def said(relay, body, role=Role.COMMAND):
    async def endpoint(request):
        request.scope["visitor"] = Visitor(role)
        return await have_a_word(request, relay)

    app = Starlette(routes=[Route("/control", endpoint, methods=["POST"])])
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://127.0.0.1") as browser:
        reply = await browser.post("/control", content=body)
    return SimpleNamespace(status=reply.status_code, **reply.json())


@pytest.mark.parametrize("ok", [True, False])
async def test_the_relay_is_asked_once_and_its_answer_comes_back_as_it_is(ok):
    relay = Relay(ControlReply(ok=ok, message="U1 is released and hovers"))
    answer = await said(relay, json.dumps({"verb": "release", "vehicle": "U1"}))
    assert relay.asked == [ControlRequest("release", "U1")]
    assert (answer.status, answer.ok, answer.message) == (200, ok, "U1 is released and hovers")


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 422),
        (b"{}", 422),
        (b'{"verb": "explode"}', 422),
        (b'{"verb": "hold", "more": 1}', 422),
        (b"\xff", 422),
        (b'{"verb": "skip", "vehicle": "' + b"x" * 2000 + b'"}', 413),
    ],
)
async def test_what_is_no_word_does_not_reach_the_relay(body, status):
    relay = Relay(ControlReply(ok=True, message="done"))
    answer = await said(relay, body)
    assert relay.asked == []
    assert (answer.status, answer.ok) == (status, False)


async def test_a_run_that_cannot_be_reached_is_no_success():
    answer = await said(Relay(BusError("the run cannot be reached: the bus is gone")), b'{"verb": "hold"}')
    assert (answer.status, answer.ok) == (503, False)
    assert "cannot be reached" in answer.message


@pytest.mark.parametrize("role", [Role.NOBODY, Role.VIEW])
async def test_nobody_but_the_operator_is_listened_to_even_past_the_gate(role):
    relay = Relay(ControlReply(ok=True, message="done"))
    answer = await said(relay, b'{"verb": "abort"}', role)
    assert (answer.status, relay.asked) == (403, [])
