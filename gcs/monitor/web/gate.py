"""The gate before everything the dashboard serves: who asks, from which page, and whether they may.

Whatever is not named here needs the role VIEW, and whatever changes something the role COMMAND: a new route is guarded
without a word of its own.
"""

from __future__ import annotations

import hmac
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from types import MappingProxyType
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from drivers.bus.openness import is_loopback
from gcs.monitor.access import Role, Tokens
from gcs.monitor.web.attempts import Attempts
from gcs.monitor.web.sessions import Session, Sessions

log = logging.getLogger(__name__)

CSRF_HEADER: Final = "x-csrf-token"
LOGIN: Final = "/login"
_OPEN: Final = frozenset({LOGIN, "/healthz", "/assets/login.css", "/assets/icon.svg"})
"""What everybody may get: the way in, and whether the process lives."""
_SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})
_HEADERS: Final = {
    "content-security-policy": "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


@dataclass(frozen=True)
class Visitor:
    """Who asks: what they may do, and their session when a browser's cookie says so."""

    role: Role
    session: Session | None = None


class RefusedError(Exception):
    """A request that is not let through: the HTTP status, and what to tell whoever asked."""

    def __init__(self, status: int, words: str, headers: Mapping[str, str] = MappingProxyType({})) -> None:
        self.status = status
        self.words = words
        self.headers = headers
        super().__init__(words)


@dataclass(frozen=True)
class Gate:
    """ASGI middleware. `loopback`: only this machine is served, so only its names are answered to."""

    app: ASGIApp
    tokens: Tokens
    sessions: Sessions
    attempts: Attempts
    tls: bool
    loopback: bool

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through with its Visitor in the scope, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        try:
            scope["visitor"] = self._admit(scope)
        except RefusedError as refusal:
            await _refuse(refusal, scope, receive, send)
            return
        await self.app(scope, receive, _guarded(send, keeps=_never_changes(scope["path"])))

    def _admit(self, scope: Scope) -> Visitor:
        headers = Headers(scope=scope)
        changes = scope["type"] == "http" and scope["method"] not in _SAFE
        host = headers.get("host", "")
        if self.loopback and not is_loopback(_name(host)):
            raise RefusedError(421, "this is served on loopback only: open it by that name")
        origin = headers.get("origin")
        if origin is not None and origin != f"{'https' if self.tls else 'http'}://{host}":
            raise RefusedError(403, "that page is not of this dashboard")
        visitor = self._visitor(headers, scope)
        if changes and visitor.session is not None and scope["path"] != LOGIN:
            self._require_own_page(headers, origin, visitor.session)
        if scope["path"] in _OPEN:
            return visitor
        if visitor.role < (needed := Role.COMMAND if changes and scope["path"] != "/logout" else Role.VIEW):
            raise RefusedError(403 if visitor.role else 401, _missing(needed, self.tokens))
        return visitor

    def _visitor(self, headers: Headers, scope: Scope) -> Visitor:
        kind, _, presented = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer":
            return Visitor(self.shown(presented.strip(), address_of(scope)))
        session = self.sessions.read(_cookie(headers, cookie_name(tls=self.tls)))
        return Visitor(self.tokens.open_role if session is None else session.role, session)

    def shown(self, presented: str, address: str) -> Role:
        """Return the role of a token somebody shows; RefusedError when it is wrong, or too many were."""
        if wait_s := self.attempts.wait_s(address):
            seconds = str(int(wait_s) + 1)
            raise RefusedError(429, f"too many wrong tokens: try again in {seconds} s", {"retry-after": seconds})
        role = self.tokens.role_of(presented)
        if role is Role.NOBODY:
            self.attempts.failed(address)
            log.warning("a wrong token from %s", address)
            raise RefusedError(401, "that token is not right")
        return role

    @staticmethod
    def _require_own_page(headers: Headers, origin: str | None, session: Session) -> None:
        if origin is None:
            raise RefusedError(403, "a browser says which page it comes from")
        if not hmac.compare_digest(headers.get(CSRF_HEADER, "").encode(), session.csrf.encode()):
            raise RefusedError(403, "that did not come from the dashboard's own page: load it anew")


def cookie_name(*, tls: bool) -> str:
    """Return the name of the session's cookie; with TLS one that no other host can set."""
    return "__Host-bearing-relay" if tls else "bearing-relay"


def _never_changes(path: str) -> bool:
    """Return whether a path holds its version, so that a browser may keep what it got; our own components' do not."""
    return path.startswith("/_nicegui/") and "/components/" not in path


def _name(host: str) -> str:
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0]


def address_of(scope: Scope) -> str:
    """Return the address a request comes from."""
    return str((scope.get("client") or ("unknown",))[0])


def _cookie(headers: Headers, name: str) -> str:
    try:
        morsel = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return ""
    return "" if morsel is None else morsel.value


def _missing(needed: Role, tokens: Tokens) -> str:
    if needed is Role.COMMAND and tokens.command is None:
        return "commanding is off: no token for it is set where the dashboard was started"
    return f"this needs the token for {'commanding' if needed is Role.COMMAND else 'viewing'}"


async def _refuse(refusal: RefusedError, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 4000 + refusal.status, "reason": refusal.words})
        return
    response: Response
    if refusal.status == 401 and "text/html" in Headers(scope=scope).get("accept", ""):
        response = RedirectResponse(LOGIN, status_code=303)
    else:
        response = JSONResponse({"ok": False, "message": refusal.words}, refusal.status, refusal.headers)
    await response(scope, receive, _guarded(send, keeps=False))


def _guarded(send: Send, *, keeps: bool) -> Send:
    """Return a `send` that adds what keeps a browser from being used against its user."""

    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
            if not keeps:
                headers["cache-control"] = "no-store"
        await send(message)

    return guarded
