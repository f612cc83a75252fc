"""Who may come in, and what browsers are told about every answer."""

from __future__ import annotations

import hmac
import secrets
import time
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from swarm.http.access import Bearer
from swarm.http.hosts import Hosts
from swarm.http.openapi import OPENAPI_PATH

COOKIE = "coadapt_console"
SIGNED_IN_S = 12 * 3600
MAX_SIGNED_IN = 256
LOGIN = "/login"
PUBLIC = (LOGIN, "/assets/", OPENAPI_PATH)
"""Paths that show nothing of the swarm."""
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    # Not `no-referrer`: the login form would then come without its origin.
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


def same_origin(headers: Headers) -> bool:
    """Whether a request that changes something comes from a page of this server."""
    try:
        origin = urlsplit(headers.get("origin", ""))
    except ValueError:
        return False
    return (
        origin.scheme in ("http", "https")
        and origin.netloc == headers.get("host", "")
        and headers.get("sec-fetch-site", "same-origin") == "same-origin"
    )


class Guard:
    """Around the application: the host's name, the token or its cookie, and the headers."""

    def __init__(self, app: ASGIApp, hosts: Hosts, token: str) -> None:
        self._app = app
        self._hosts = hosts
        self._token = token
        self._bearer = Bearer(token)
        self._signed_in: dict[str, float] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers[name] = value
            await send(message)

        refusal = self._refusal(scope)
        await (refusal or self._app)(scope, receive, with_headers)

    def sign_in(self, token: str) -> str | None:
        """The value of a new cookie for who knows the token, else None."""
        if not self._token or not self._bearer.may(f"Bearer {token}"):
            return None
        while len(self._signed_in) >= MAX_SIGNED_IN:
            del self._signed_in[next(iter(self._signed_in))]
        cookie = secrets.token_urlsafe(32)
        self._signed_in[cookie] = time.monotonic() + SIGNED_IN_S
        return cookie

    def _refusal(self, scope: Scope) -> Response | None:
        headers, path = Headers(scope=scope), scope["path"]
        if not self._hosts.may(headers.get("host", "")):
            return JSONResponse({"error": "the console does not answer to this name"}, 421)
        if any(path.startswith(one) for one in PUBLIC) or self._may(headers):
            return None
        if path == "/":
            return RedirectResponse(LOGIN, 303)
        return JSONResponse(
            {"error": "this needs the console's token"}, 401, {"WWW-Authenticate": "Bearer"}
        )

    def _may(self, headers: Headers) -> bool:
        if self._bearer.may(headers.get("authorization", "")):
            return True
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return False
        shown = morsel.value.encode() if morsel is not None else b""
        now = time.monotonic()
        return any(
            hmac.compare_digest(shown, cookie.encode()) and now < until
            for cookie, until in self._signed_in.items()
        )
