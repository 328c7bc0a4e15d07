"""The way in: a page that takes a token and gives a session for it. It needs no script."""

from __future__ import annotations

from html import escape
from typing import Final
from urllib.parse import parse_qs

from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from gcs.monitor.web.gate import Gate, RefusedError, address_of, cookie_name
from gcs.monitor.web.sessions import LASTS_S

_LARGEST_FORM: Final = 4096
_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Sign in – bearing-relay</title>
<link rel="icon" href="/assets/icon.svg"><link rel="stylesheet" href="/assets/login.css"></head>
<body><main><h1>bearing-relay</h1><form method="post" action="/login">
<p><label for="token">Token for viewing or for commanding</label></p>
<input id="token" name="token" type="password" autocomplete="current-password" required autofocus>
{wrong}<button type="submit">Sign in</button></form>{back}</main></body></html>"""


def login_page(*, wrong: str = "", open_to_all: bool = False, status: int = 200) -> Response:
    """Return the page with what was wrong the last time."""
    words = f'<p class="wrong" role="alert">{escape(wrong)}</p>' if wrong else ""
    back = '<p><a href="/">Only look</a></p>' if open_to_all else ""
    return HTMLResponse(_PAGE.format(wrong=words, back=back), status)


async def log_in(request: Request, gate: Gate) -> Response:
    """Return a redirect with a session for the token in the form, or the page with what is wrong."""
    open_to_all = bool(gate.tokens.open_role)
    if "origin" not in request.headers:
        return login_page(wrong="a browser says which page it comes from", open_to_all=open_to_all, status=403)
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > _LARGEST_FORM:
            return login_page(wrong="that is no token", open_to_all=open_to_all, status=413)
    token = parse_qs(body.decode("ascii", errors="replace")).get("token", [""])[0].strip()
    try:
        role = gate.shown(token, address_of(request.scope))
    except RefusedError as refusal:
        page = login_page(wrong=refusal.words, open_to_all=open_to_all, status=refusal.status)
        page.headers.update(refusal.headers)
        return page
    answer = RedirectResponse("/", status_code=303)
    answer.set_cookie(
        cookie_name(tls=gate.tls),
        gate.sessions.issue(role),
        max_age=LASTS_S,
        path="/",
        secure=gate.tls,
        httponly=True,
        samesite="strict",
    )
    return answer


def log_out(gate: Gate) -> Response:
    """Return an answer that ends the session in this browser."""
    answer = Response(status_code=204)
    answer.delete_cookie(cookie_name(tls=gate.tls), path="/", secure=gate.tls, httponly=True, samesite="strict")
    return answer
