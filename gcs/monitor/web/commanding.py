"""The operator's word, from the page to the relay and the answer back."""

from __future__ import annotations

import logging
from typing import Final

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from drivers.bus.messages import ControlReply, ControlRequest, MalformedMessageError, decode
from drivers.errors import BusError
from gcs.monitor.access import Role
from gcs.monitor.client import RunClient
from gcs.monitor.web.gate import Visitor, address_of

log = logging.getLogger(__name__)

_LARGEST_REQUEST: Final = 1024


async def have_a_word(request: Request, client: RunClient) -> Response:
    """Return what the relay answered to the ControlRequest in a request; it is said once, and never again by itself."""
    visitor: Visitor = request.scope["visitor"]
    if visitor.role is not Role.COMMAND:  # the gate lets nobody else come here; should it ever
        return _answer(403, "this needs the token for commanding")
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > _LARGEST_REQUEST:
            return _answer(413, "that is no control request")
    try:
        asked = decode(body, ControlRequest)
    except MalformedMessageError as error:
        return _answer(422, f"no control request: {error}")
    word = " ".join(filter(None, (asked.verb, asked.vehicle)))
    try:
        reply, status = await client.command(asked), 200
    except BusError as error:
        reply, status = ControlReply(ok=False, message=str(error)), 503
    log.info("%s, asked by %s: %s", word, address_of(request.scope), reply.message)
    return _answer(status, reply.message, ok=reply.ok)


def _answer(status: int, message: str, *, ok: bool = False) -> Response:
    return JSONResponse({"ok": ok, "message": message}, status)
