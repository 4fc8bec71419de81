"""The names that the page answers to. A browser that was led to it by a page of somebody else is refused.

Two attacks are met: another page sends requests to this one (its `Origin` differs), and another page's own name is made to
resolve to this machine (DNS rebinding; the `Host` is then a name that this server was never told).
"""

from __future__ import annotations

import dataclasses

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bt_jax.app.access.address import host_of, is_loopback

__all__ = ["HEADERS", "GuardHosts"]

HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'self'",
    "X-Frame-Options": "SAMEORIGIN",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
}


@dataclasses.dataclass(frozen=True)
class GuardHosts:
    """ASGI middleware that answers 400 to a foreign `Host` or `Origin`, on HTTP and websockets, and adds the `HEADERS`.

    The page answers to loopback's names, to the address that the connection came in on, and to `names`. It may be called
    from the same host and port only; a reverse proxy has to pass the `Host` on.
    """

    app: ASGIApp
    names: frozenset[str] = frozenset()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        problem = self._problem(scope)
        app = PlainTextResponse(f"{problem}\n", status_code=400) if problem else self.app
        await app(scope, receive, _with_headers(send))

    def _problem(self, scope: Scope) -> str:
        """Return why a request is refused, empty if it is not."""
        headers = Headers(scope=scope)
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        name = host_of(hosts[0]) if len(hosts) == 1 else ""
        if not name:
            return "the request names no valid host"
        here = (scope.get("server") or ("",))[0]
        if not (is_loopback(name) or name == here.lower() or name in self.names):
            return (
                f"this page is not served under the name {name}; open it under another, or start it with "
                f"--allow-host {name}"
            )
        if any(not _same(origin, hosts[0]) for origin in origins):
            return "this page cannot be used from another page"
        return ""


def _same(origin: str, host: str) -> bool:
    """Whether a page of this origin is one of the host."""
    scheme, _, rest = origin.partition("://")
    return scheme in ("http", "https") and rest.lower() == host.lower()


def _with_headers(send: Send) -> Send:
    async def send_with(message: Message) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            headers = MutableHeaders(scope=message)
            for key, value in HEADERS.items():
                headers[key] = value
        await send(message)

    return send_with
