"""The API: a run in JSON, live over a WebSocket, as Prometheus metrics, and its health. It can change nothing."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, FastAPI, Query
from starlette.responses import JSONResponse, Response
from starlette.websockets import WebSocket

from drivers.bus.run_messages import Events
from gcs.monitor.client import RunClient
from gcs.monitor.metrics.live_socket import LiveSockets
from gcs.monitor.metrics.openapi import Health, openapi
from gcs.monitor.metrics.prometheus import CONTENT_TYPE, RunMetrics

_NO_STORE = {"cache-control": "no-store"}


def api_router(client: RunClient) -> APIRouter:
    """Return the routes for the run a client follows, to be included in an application."""
    router, metrics, sockets = APIRouter(), RunMetrics(client), LiveSockets(client)

    @router.get("/api/v1/setup")
    async def _() -> Response:
        return _json(client.setup, client)

    @router.get("/api/v1/state")
    async def _() -> Response:
        return _json(client.state, client)

    @router.get("/api/v1/events")
    async def _(first: Annotated[int, Query(ge=0)] = 0) -> Response:
        return _json(Events([event for event in client.events if event.number >= first]), client)

    @router.websocket("/api/v1/live")
    async def _(socket: WebSocket) -> None:
        await sockets.serve(socket)

    @router.get("/api/v1/openapi.json")
    async def _() -> dict[str, Any]:
        return openapi()

    @router.get("/healthz")
    async def _() -> Response:
        health = health_of(client)
        return Response(msgspec.json.encode(health), 503 if health.status == "lost" else 200, _NO_STORE, _JSON)

    @router.get("/metrics")
    async def _() -> Response:
        return Response(metrics.text(), headers={"content-type": CONTENT_TYPE, **_NO_STORE})

    return router


def api_app(client: RunClient) -> FastAPI:
    """Return an application that serves nothing else."""
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    app.include_router(api_router(client))
    return app


def health_of(client: RunClient) -> Health:
    """Return whether the run is being heard of."""
    if client.ended:
        return Health("ended")
    return Health("lost", client.alerts()[0].text) if client.lost else Health("ok")


_JSON = "application/json"


def _json(message: msgspec.Struct | None, client: RunClient) -> Response:
    if message is None:
        return JSONResponse(msgspec.to_builtins(health_of(client)), 503, _NO_STORE)
    return Response(msgspec.json.encode(message), 200, _NO_STORE, _JSON)
