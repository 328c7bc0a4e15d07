"""The gate: every way to get at the run without being allowed to."""

import re

import httpx
import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute

from gcs.monitor.access import Token, Tokens
from gcs.monitor.web.attempts import ALLOWED, WITHIN_S, Attempts
from gcs.monitor.web.gate import Gate
from gcs.monitor.web.login import log_in, log_out
from gcs.monitor.web.sessions import LASTS_S, Sessions
from tests.fakes import ManualClock

VIEW = "view-0123456789abcdef"
COMMAND = "command-0123456789abcdef"
BOTH = Tokens(Token(VIEW), Token(COMMAND))
OWN = "http://127.0.0.1:8080"


class Site:
    """The gate before a page that says who came, as a browser or a program would see it."""

    def __init__(self, tokens=BOTH, *, tls=False, loopback=True, base=OWN):
        self.clock = ManualClock()
        self.reached = []
        routes = [
            Route("/{path:path}", self._reach, methods=["GET", "POST", "PUT", "DELETE"]),
            WebSocketRoute("/live", self._reach_socket),
        ]
        routes.insert(0, Route("/login", self._log_in, methods=["POST"]))
        routes.insert(0, Route("/logout", self._log_out, methods=["POST"]))
        app = Starlette(routes=routes)
        self.gate = Gate(app, tokens, Sessions(tokens, self.clock), Attempts(self.clock), tls=tls, loopback=loopback)
        self.browser = self.another(base)

    def another(self, base=OWN, address="127.0.0.1"):
        transport = httpx.ASGITransport(self.gate, client=(address, 4321))
        return httpx.AsyncClient(transport=transport, base_url=base)

    async def _reach(self, request):
        self.reached.append(request.method)
        session = request.scope["visitor"].session
        return PlainTextResponse(f"{request.scope['visitor'].role.name} {session.csrf if session else ''}")

    async def _reach_socket(self, socket):
        self.reached.append("websocket")
        await socket.accept()
        await socket.close()

    async def _log_in(self, request):
        return await log_in(request, self.gate)

    async def _log_out(self, _):
        return log_out(self.gate)

    async def sign_in(self, token, origin=OWN):
        return await self.browser.post("/login", data={"token": token}, headers={"origin": origin})

    async def csrf(self):
        return (await self.browser.get("/about")).text.split()[1]

    async def command(self, **headers):
        return await self.browser.post("/control", content=b"{}", headers={"origin": OWN} | headers)

    async def open_socket(self, **headers):
        """Return the code a WebSocket is closed with before it is open, or None when it opens."""
        sent = []

        async def receive():
            return {"type": "websocket.connect"}

        async def send(message):
            sent.append(message)

        told = {"host": "127.0.0.1:8080"} | headers
        scope = {
            "type": "websocket",
            "path": "/live",
            "headers": [(name.encode(), value.encode()) for name, value in told.items()],
            "client": ("127.0.0.1", 4321),
            "query_string": b"",
            "subprotocols": [],
        }
        await self.gate(scope, receive, send)
        return sent[0]["code"] if sent[0]["type"] == "websocket.close" else None


async def test_without_a_token_set_all_may_look_and_nobody_command():
    site = Site(Tokens())
    assert (await site.browser.get("/")).text.startswith("VIEW")
    answer = await site.command()
    assert answer.status_code == 403
    assert "commanding is off" in answer.json()["message"]
    assert site.reached == ["GET"]


async def test_nobody_without_a_token_gets_anything_but_the_way_in():
    site = Site()
    for path in ("/", "/about", "/report", "/metrics", "/api/v1/state", "/assets/store.js", "/_nicegui/x"):
        assert (await site.browser.get(path)).status_code == 401, path
    assert await site.open_socket() == 4401
    assert site.reached == []
    page = await site.browser.get("/", headers={"accept": "text/html"})
    assert (page.status_code, page.headers["location"]) == (303, "/login")
    assert (await site.browser.get("/healthz")).status_code == 200


async def test_a_signed_in_viewer_looks_but_does_not_command():
    site = Site()
    answer = await site.sign_in(VIEW)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    assert (await site.browser.get("/")).text.startswith("VIEW")
    refused = await site.command(**{"x-csrf-token": await site.csrf()})
    assert refused.status_code == 403
    assert "POST" not in site.reached


async def test_the_operator_commands_from_the_dashboards_own_page_only():
    site = Site()
    await site.sign_in(COMMAND)
    csrf = await site.csrf()
    refused = [
        await site.command(),
        await site.command(**{"x-csrf-token": "0" * len(csrf)}),
        await site.command(**{"x-csrf-token": csrf, "origin": "http://evil.example"}),
        await site.command(**{"x-csrf-token": csrf, "origin": "null"}),
        await site.command(**{"x-csrf-token": csrf, "origin": "https://127.0.0.1:8080"}),
        await site.browser.post("/control", content=b"{}", headers={"x-csrf-token": csrf}),
    ]
    assert [answer.status_code for answer in refused] == [403] * len(refused)
    assert "POST" not in site.reached
    assert (await site.command(**{"x-csrf-token": csrf})).status_code == 200


async def test_the_csrf_word_of_another_session_is_no_good():
    site = Site()
    await site.sign_in(COMMAND)
    first = await site.csrf()
    await site.sign_in(COMMAND)
    assert await site.csrf() != first
    assert (await site.command(**{"x-csrf-token": first})).status_code == 403


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE"])
async def test_any_route_that_changes_something_needs_the_command_role(method):
    site = Site()
    await site.sign_in(VIEW)
    headers = {"origin": OWN, "x-csrf-token": await site.csrf()}
    assert (await site.browser.request(method, "/anything/new", headers=headers)).status_code == 403


async def test_another_sites_page_opens_no_stream_even_where_all_may_look():
    site = Site(Tokens())
    assert await site.open_socket(origin="http://evil.example") == 4403
    assert await site.open_socket(origin="http://127.0.0.1:9999") == 4403
    assert await site.open_socket(origin=OWN) is None


async def test_on_loopback_a_name_that_was_made_to_point_there_is_not_answered():
    site = Site(Tokens())
    for host in ("evil.example", "evil.example:8080", "127.0.0.1.evil.example"):
        assert (await site.browser.get("/", headers={"host": host})).status_code == 421, host
    for host in ("localhost:8080", "[::1]:8080", "127.0.0.1"):
        assert (await site.browser.get("/", headers={"host": host})).status_code == 200, host


async def test_a_program_shows_its_token_in_a_header():
    site = Site()
    headers = {"authorization": f"Bearer {VIEW}"}
    assert (await site.browser.get("/metrics", headers=headers)).text.startswith("VIEW")
    assert (await site.browser.post("/control", headers=headers)).status_code == 403
    commander = {"authorization": f"Bearer {COMMAND}"}
    assert (await site.browser.post("/control", headers=commander)).status_code == 200
    assert (await site.browser.get("/metrics", headers={"authorization": "Bearer no"})).status_code == 401
    assert await site.open_socket(authorization=f"Bearer {VIEW}") is None


async def test_a_token_in_a_url_is_not_looked_at():
    site = Site()
    for path in (f"/?token={VIEW}", f"/login?token={COMMAND}"):
        answer = await site.browser.get(path)
        assert "set-cookie" not in answer.headers
    assert (await site.browser.get(f"/about?token={COMMAND}")).status_code == 401


async def test_who_gives_too_many_wrong_tokens_waits_and_nobody_else():
    site = Site()
    for _ in range(ALLOWED):
        assert (await site.sign_in("wrong-0123456789")).status_code == 401
    locked = await site.sign_in(COMMAND)
    assert locked.status_code == 429
    assert int(locked.headers["retry-after"]) == WITHIN_S + 1
    bearer = await site.browser.get("/", headers={"authorization": f"Bearer {VIEW}"})
    assert bearer.status_code == 429
    other = site.another(address="127.0.0.2")
    assert (await other.post("/login", data={"token": VIEW}, headers={"origin": OWN})).status_code == 303
    site.clock.jump(WITHIN_S + 1)
    assert (await site.sign_in(COMMAND)).status_code == 303


async def test_a_session_that_began_before_is_not_locked_out():
    site = Site()
    await site.sign_in(COMMAND)
    for _ in range(2 * ALLOWED):
        await site.another().post("/login", data={"token": "wrong-0123456789"}, headers={"origin": OWN})
    assert (await site.command(**{"x-csrf-token": await site.csrf()})).status_code == 200


def test_a_whole_ipv6_network_counts_as_one_and_few_are_remembered():
    clock = ManualClock()
    attempts = Attempts(clock)
    for k in range(ALLOWED):
        attempts.failed(f"2001:db8::{k}")
    assert attempts.wait_s("2001:db8::ffff") > 0.0
    assert attempts.wait_s("2001:db8:1::1") == 0.0
    for k in range(5000):
        attempts.failed(f"10.0.{k // 250}.{k % 250}")
    assert len(attempts._failed_s) <= 1000


async def test_a_session_ends_with_its_time_and_with_its_token():
    site = Site()
    cookie = (await site.sign_in(COMMAND)).cookies["bearing-relay"]
    later = Sessions(BOTH, site.clock)
    assert later.read(cookie) is not None  # also after a restart
    changed = Tokens(Token(VIEW), Token("another-0123456789abcdef"))
    assert Sessions(changed, site.clock).read(cookie) is None
    site.clock.jump(LASTS_S + 1)
    assert later.read(cookie) is None


def test_a_cookie_that_was_changed_is_no_session():
    sessions = Sessions(BOTH, ManualClock())
    cookie = sessions.issue(sessions.tokens.role_of(VIEW))
    role, expires, nonce, signature = cookie.split(".")
    changed = [
        f"COMMAND.{expires}.{nonce}.{signature}",
        f"{role}.{int(expires) + 1}.{nonce}.{signature}",
        f"{role}.{expires}.{nonce}.",
        f"NOBODY.{expires}.{nonce}.{signature}",
        f"{role}.²{expires}.{nonce}.{signature}",
        "",
        "....",
        "x" * 10_000,
        "ü.1.2.3",
    ]
    assert sessions.read(cookie) is not None
    assert [sessions.read(one) for one in changed] == [None] * len(changed)


async def test_the_cookie_is_kept_from_scripts_other_sites_and_plain_http():
    told = (await Site().sign_in(VIEW)).headers["set-cookie"].lower()
    assert {"httponly", "samesite=strict", "path=/"} <= set(told.split("; "))
    over_tls = Site(tls=True, base="https://127.0.0.1:8080")
    answer = await over_tls.sign_in(VIEW, origin="https://127.0.0.1:8080")
    assert answer.headers["set-cookie"].startswith("__Host-")
    assert "Secure" in answer.headers["set-cookie"]


async def test_a_form_from_elsewhere_does_not_sign_in():
    site = Site()
    assert (await site.browser.post("/login", data={"token": VIEW})).status_code == 403
    assert (await site.sign_in(VIEW, origin="http://evil.example")).status_code == 403
    assert (await site.browser.post("/login", content=b"x" * 100_000, headers={"origin": OWN})).status_code == 413


async def test_signing_out_ends_the_session_in_the_browser():
    site = Site()
    await site.sign_in(VIEW)
    headers = {"origin": OWN, "x-csrf-token": await site.csrf()}
    assert (await site.browser.post("/logout", headers={"origin": OWN})).status_code == 403
    assert (await site.browser.post("/logout", headers=headers)).status_code == 204
    assert (await site.browser.get("/")).status_code == 401


async def test_every_answer_forbids_framing_foreign_content_and_keeping():
    site = Site()
    for answer in (
        await site.browser.get("/"),
        await site.browser.get("/healthz"),
        await site.sign_in("wrong-0123456789"),
    ):
        policy = answer.headers["content-security-policy"]
        assert "frame-ancestors 'none'" in policy
        assert not re.search(r"https?:|\*", policy)
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["cache-control"] == "no-store"


async def test_no_answer_holds_a_token():
    site = Site()
    answers = [await site.sign_in(VIEW), await site.sign_in(COMMAND), await site.sign_in(VIEW + "x")]
    answers.append(await site.browser.get("/"))
    for answer in answers:
        said = answer.text + str(answer.headers)
        assert VIEW not in said
        assert COMMAND not in said
