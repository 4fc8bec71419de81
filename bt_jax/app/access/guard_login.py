"""The door of a page that others can reach: the form for the token, and the cookie of a login."""

from __future__ import annotations

import asyncio
import dataclasses
from pathlib import Path
from string import Template
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bt_jax.app.access.logins import LOGIN_HOURS, Logins

__all__ = ["GuardLogin"]

MOST_BYTES = 4096  # of a form
FORM = Template((Path(__file__).parents[1] / "static" / "login.html").read_text(encoding="utf-8"))
EXPIRED = 4401  # why a websocket is closed


@dataclasses.dataclass(frozen=True)
class GuardLogin:
    """ASGI middleware that lets only those in who are logged in: others get the form, or 401. A login is a cookie that
    scripts cannot read and other pages cannot send; a websocket is closed when it ends."""

    app: ASGIApp
    logins: Logins

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        key = _cookie(scope)
        left = self.logins.left(key)
        if scope["type"] == "http" and scope["path"] == "/login":
            await (await self._login(scope, receive))(scope, receive, send)
        elif left and scope["type"] == "websocket":
            await self.app(scope, self._until_the_end(key, receive, send), send)
        elif left:
            await self.app(scope, receive, send)
        else:
            await _refusal(scope)(scope, receive, send)

    def _until_the_end(self, key: str, receive: Receive, send: Send) -> Receive:
        """Return a `receive` that closes the websocket when a login ends."""

        async def receive_until() -> Message:
            try:
                message = await asyncio.wait_for(receive(), self.logins.left(key))
            except TimeoutError:
                message = None
            if message is not None and (self.logins.left(key) or message["type"] == "websocket.disconnect"):
                return message
            await send({"type": "websocket.close", "code": EXPIRED})
            return {"type": "websocket.disconnect", "code": EXPIRED}

        return receive_until

    async def _login(self, scope: Scope, receive: Receive) -> Response:
        """Answer a token that was typed (POST), or that is in the address (GET)."""
        address = (scope.get("client") or ("",))[0]
        wait = self.logins.wait(address)
        if wait:
            said = f"Too many wrong tokens; try again in {wait:.0f} seconds."
            return HTMLResponse(_form(said), 429, {"Retry-After": f"{wait:.0f}"})
        if scope["method"] == "POST":
            sent = await _body(receive)
        else:
            sent = scope["query_string"]
        token = _token(sent)
        if not token:
            return HTMLResponse(_form(""), 401)
        key = self.logins.log_in(token, address)
        if key is None:
            return HTMLResponse(_form("This token is wrong; copy the one that the terminal shows."), 401)
        # Not a redirect: where the address was clicked in another page, a browser would follow it without the cookie.
        answer = HTMLResponse('<!doctype html><meta http-equiv="refresh" content="0; url=/">')
        answer.set_cookie(
            _cookie_name(scope),
            key,
            max_age=round(3600 * LOGIN_HOURS),
            httponly=True,
            samesite="strict",
            secure=scope["scheme"] == "https",
        )
        return answer


def _token(sent: bytes) -> str:
    """Return the token of a form, empty if there is none."""
    try:
        return parse_qs(sent.decode("ascii", "replace"), max_num_fields=10).get("token", [""])[0]
    except ValueError:
        return ""


def _refusal(scope: Scope) -> Response:
    """Return what somebody gets who is not logged in."""
    wants_page = "text/html" in Headers(scope=scope).get("accept", "")
    if scope["type"] == "http" and scope["method"] == "GET" and scope["path"] == "/" and wants_page:
        return RedirectResponse("/login", 303)
    return PlainTextResponse("log in first\n", 401)


def _form(problem: str) -> str:
    return FORM.substitute(problem=problem, hours=f"{LOGIN_HOURS:g}")


def _cookie_name(scope: Scope) -> str:
    """Return a name of its own for each server: cookies are shared by all ports of a host."""
    return f"bt_jax_{(scope.get('server') or ('', 0))[1]}"


def _cookie(scope: Scope) -> str:
    """Return the key of a login, empty if there is none; cookies of other programs on this host may say anything."""
    return cookie_parser(Headers(scope=scope).get("cookie", "")).get(_cookie_name(scope), "")


async def _body(receive: Receive) -> bytes:
    """Return the body of a request, empty if it is too long for a form."""
    body, more = b"", True
    while more:
        message = await receive()
        body += message.get("body", b"")
        more = message.get("more_body", False) and len(body) <= MOST_BYTES
    return body if len(body) <= MOST_BYTES else b""
