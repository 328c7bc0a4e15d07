"""The OpenAPI document of the API: its paths, and the schemas of its messages as the bus publishes them."""

from __future__ import annotations

from typing import Any

import msgspec

from drivers.bus.run_messages import KINDS
from gcs.monitor.metrics.live_socket import LiveMessage


class Health(msgspec.Struct, frozen=True):
    """Whether the run is being heard of: "ok", "ended" when it is over, or else "lost" and why."""

    status: str
    problem: str = ""


def openapi() -> dict[str, Any]:
    """Return the document."""
    kinds = (*KINDS, LiveMessage, Health)
    _, schemas = msgspec.json.schema_components(kinds, ref_template="#/components/schemas/{name}")
    first = {
        "name": "first",
        "in": "query",
        "description": "the number of the first event wanted",
        "schema": {"type": "integer", "minimum": 0, "default": 0},
    }
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "bearing-relay",
            "version": "1",
            "description": "A run as the service tells it. Read-only. Places in the formation frame, m; angles in rad.",
        },
        "paths": {
            "/api/v1/setup": {"get": _get("What the run is about.", "RunSetup")},
            "/api/v1/state": {"get": _get("The run's latest state.", "RunState")},
            "/api/v1/events": {"get": {**_get("The latest events, in order.", "Events"), "parameters": [first]}},
            "/api/v1/live": {
                "get": {
                    "summary": "A WebSocket: setup, state and events as they come, each message a LiveMessage.",
                    "description": "Whoever does not keep up gets the latest state, and the latest events.",
                    "responses": {"101": {"description": "switching to WebSocket", "content": _content("LiveMessage")}},
                }
            },
            "/healthz": {
                "get": {
                    "summary": "Whether the run is being heard of.",
                    "responses": {
                        "200": {"description": "it is, or it has ended", "content": _content("Health")},
                        "503": {"description": "it is not", "content": _content("Health")},
                    },
                }
            },
            "/metrics": {
                "get": {
                    "summary": "Prometheus metrics.",
                    "responses": {"200": {"description": "text", "content": {"text/plain": {}}}},
                }
            },
        },
        "components": {"schemas": schemas},
    }


def _get(summary: str, kind: str) -> dict[str, Any]:
    return {
        "summary": summary,
        "responses": {
            "200": {"description": summary, "content": _content(kind)},
            "503": {"description": "nothing has been heard of a run yet", "content": _content("Health")},
        },
    }


def _content(kind: str) -> dict[str, Any]:
    return {"application/json": {"schema": {"$ref": f"#/components/schemas/{kind}"}}}
