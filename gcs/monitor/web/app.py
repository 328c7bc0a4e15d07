"""The application behind the gate: every route that the dashboard answers."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec
from fastapi import FastAPI
from nicegui import app as nicegui_app
from nicegui import ui
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, RedirectResponse, Response
from starlette.staticfiles import StaticFiles

from drivers.clock import Clock
from gcs.monitor.access import Tokens
from gcs.monitor.client import RunClient
from gcs.monitor.metrics.api import api_router
from gcs.monitor.web import components
from gcs.monitor.web.attempts import Attempts
from gcs.monitor.web.commanding import have_a_word
from gcs.monitor.web.finding import RunFinder
from gcs.monitor.web.gate import Gate, Visitor
from gcs.monitor.web.login import log_in, log_out, login_page
from gcs.monitor.web.past import past_of
from gcs.monitor.web.sessions import Sessions

ASSETS: Final = Path(__file__).parent / "assets"
_REPORT_POLICY: Final = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:"
"""The report is a document: whatever got into it runs nothing, and says nothing in the operator's name."""


def dashboard_app(
    client: RunClient, finder: RunFinder, tokens: Tokens, clock: Clock, *, tls: bool, loopback: bool
) -> Gate:
    """Return the application, to be served. NiceGUI keeps its state in its module: one application to a process."""
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    gate = Gate(app, tokens, Sessions(tokens, clock), Attempts(clock), tls=tls, loopback=loopback)
    _add_sessions(app, gate)
    _add_run(app, gate, client, finder)
    app.include_router(api_router(client))
    app.mount("/assets", StaticFiles(directory=ASSETS))
    nicegui_app.config.socket_io_js_transports = ["websocket"]  # polling would change things by POST
    nicegui_app.config.quasar_config["loadingBar"] = {"skipHijack": True}  # no bar that nobody can tell what of
    ui.page("/")(components.build)
    ui.run_with(
        app,
        title="bearing-relay",
        favicon=ASSETS / "icon.svg",
        dark=None,
        language="en-US",
        tailwind=False,
        binding_refresh_interval=None,
        show_welcome_message=False,
    )
    return gate


def _add_sessions(app: FastAPI, gate: Gate) -> None:
    @app.get("/login")
    def _() -> Response:
        return login_page(open_to_all=bool(gate.tokens.open_role))

    @app.post("/login")
    async def _(request: Request) -> Response:
        return await log_in(request, gate)

    @app.post("/logout")
    def _() -> Response:
        return log_out(gate)


def _add_run(app: FastAPI, gate: Gate, client: RunClient, finder: RunFinder) -> None:
    @app.get("/about")
    def _(request: Request) -> Response:
        visitor: Visitor = request.scope["visitor"]
        return JSONResponse(
            {
                "role": visitor.role.name,
                "csrf": visitor.session.csrf if visitor.session else "",
                "signed_in": visitor.session is not None,
                "commanding": gate.tokens.command is not None,
                "report": "/report" if finder.report() else None,
                "problem": client.problem,
            }
        )

    @app.get("/past")
    async def _() -> Response:
        return Response(msgspec.json.encode(past_of(client)), media_type="application/json")

    @app.post("/control")
    async def _(request: Request) -> Response:
        return await have_a_word(request, client)

    @app.get("/report")
    def _() -> Response:
        path = finder.report()
        if path is None:
            return RedirectResponse("/", status_code=303)
        return FileResponse(path, media_type="text/html", headers={"content-security-policy": _REPORT_POLICY})
