"""The robot's side of Robot Web Services 1.0, for the twin: the addresses, answers and habits of an IRC5, as far as `rws`
and public clients meet them.

Digest access, then a session by cookies that ends with /logout or after a while; forms of one content type; 503 for whoever
asks too often or opens too many sessions; ABB's return codes in refusals. Sources: see `link.rws` and `link.rws_errors`.
"""

from __future__ import annotations

import collections
import dataclasses
import hashlib
import http.cookies
import http.server
import json
import secrets
import threading
import time
import urllib.parse
import urllib.request
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from bt_jax.deploy.link.rws import ControllerMessage

__all__ = ["PASSWORD", "USER", "Controlled", "RwsLimits", "serve_rws"]

USER, PASSWORD = "Default User", "robotics"  # as a controller is delivered
REALM = "validusers@robapi.abb"
SYMBOLS = "/rw/rapid/symbol/data/"
FORM = "application/x-www-form-urlencoded"
SESSION = "-http-session-"  # the name of the session's cookie; ABBCX accompanies it
NOT_FOUND, REJECTED, WRONG_STATE, INVALID = -1073414146, -1073445881, -1073442809, -1073445879  # ABB's return codes


@dataclasses.dataclass(frozen=True)
class RwsLimits:
    """What the server puts up with."""

    rate: float = 20.0  # requests in a second, above which it answers 503 (one public client's figure)
    delay: float = 0.0  # seconds that an answer takes
    sessions: int = 70  # at a time, above which it answers 503 (estimate from ABB's manual of later versions)
    idle: float = 300.0  # seconds after which a session ends that asks nothing (estimate)


@runtime_checkable
class Controlled(Protocol):
    """What the requests act on; called from the server's threads."""

    control: str  # motoron ...
    mode: str  # AUTO ...

    @property
    def rapid(self) -> bool: ...

    @property
    def messages(self) -> Sequence[ControllerMessage]: ...  # the event log, the oldest first

    def start_rapid(self) -> bool: ...

    def stop_rapid(self) -> None: ...

    def number(self, url: str) -> float: ...  # KeyError if there is no such symbol

    def set_number(self, url: str, value: float) -> None: ...


def serve_rws(
    controlled: Controlled, port: int, limits: RwsLimits | None = None, *, host: str = "127.0.0.1"
) -> http.server.ThreadingHTTPServer:
    """Serve on one interface in threads of this process; port 0 takes any free one."""
    state = _ServerState(limits or RwsLimits())
    handler = type("Handler", (_Handler,), {"controlled": controlled, "state": state})
    server = http.server.ThreadingHTTPServer((host, port), handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


class _ServerState:
    """Requests of the last second and open sessions, of all connections."""

    def __init__(self, limits: RwsLimits) -> None:
        self.limits, self.nonce, self.cycle = limits, secrets.token_hex(16), "forever"
        self._lock = threading.Lock()
        self._recent: collections.deque[float] = collections.deque()
        self._sessions: dict[str, float] = {}  # by cookie, when it was used last

    def admit(self) -> bool:
        """Count a request; return whether it may be answered."""
        with self._lock:
            now = time.monotonic()
            while self._recent and self._recent[0] <= now - 1:
                self._recent.popleft()
            self._recent.append(now)
            return len(self._recent) <= self.limits.rate

    def resume(self, cookie: str | None) -> bool:
        """Return whether a cookie is that of an open session, which then lives on."""
        with self._lock:
            now = time.monotonic()
            self._sessions = {name: used for name, used in self._sessions.items() if used > now - self.limits.idle}
            if cookie is None or cookie not in self._sessions:
                return False
            self._sessions[cookie] = now
            return True

    def open(self) -> str | None:
        """Return the cookie of a new session; None if there are too many."""
        with self._lock:
            if len(self._sessions) >= self.limits.sessions:
                return None
            cookie = secrets.token_hex(8)
            self._sessions[cookie] = time.monotonic()
            return cookie

    def end(self, cookie: str | None) -> None:
        """End a session."""
        with self._lock:
            self._sessions.pop(cookie or "", None)


class _Handler(http.server.BaseHTTPRequestHandler):
    controlled: Controlled
    state: _ServerState
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    opened: str | None = None  # the cookie of a session that this request has opened

    def do_GET(self) -> None:
        if not self._allowed():
            return
        url = urllib.parse.urlsplit(self.path)
        robot, path = self.controlled, url.path
        if path == "/logout":
            self.state.end(self._cookie())
            self._answer(200)
        elif path == "/rw/panel/ctrlstate":
            self._state(ctrlstate=robot.control)
        elif path == "/rw/panel/opmode":
            self._state(opmode=robot.mode)
        elif path == "/rw/rapid/execution":
            self._state(ctrlexecstate="running" if robot.rapid else "stopped", cycle=self.state.cycle)
        elif path == "/rw/elog/0":
            query = urllib.parse.parse_qs(url.query)
            messages = list(robot.messages)
            if query.get("order", ["lifo"])[0] == "lifo":
                messages.reverse()
            limit = int(query.get("limit", ["50"])[0])
            self._states([_message(each) for each in messages[:limit]])
        elif path.startswith(SYMBOLS):
            try:
                self._state(value=f"{robot.number(path.removeprefix(SYMBOLS)):g}")
            except KeyError:
                self._refuse(404, NOT_FOUND)
        else:
            self._refuse(404, NOT_FOUND)

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        if not self._allowed():
            return
        if body and self.headers.get_content_type() != FORM:
            self._refuse(415, INVALID)
            return
        form = {name: values[0] for name, values in urllib.parse.parse_qs(body.decode()).items()}
        url = urllib.parse.urlsplit(self.path)
        action = urllib.parse.parse_qs(url.query).get("action", [""])[0]
        if url.path == "/rw/rapid/execution":
            self._execute(action, form)
        elif url.path.startswith(SYMBOLS) and action == "set":
            try:
                self.controlled.set_number(url.path.removeprefix(SYMBOLS), float(form["value"]))
                self._answer(204)
            except (KeyError, ValueError) as problem:
                missing = isinstance(problem, KeyError) and "value" in form
                self._refuse(404 if missing else 400, NOT_FOUND if missing else INVALID)
        else:
            self._refuse(404, NOT_FOUND)

    def _execute(self, action: str, form: dict[str, str]) -> None:
        robot = self.controlled
        if action == "resetpp":
            self._answer(204) if not robot.rapid else self._refuse(403, REJECTED)
        elif action == "start" and "execmode" in form and form.get("cycle") in ("forever", "once", "asis"):
            if not robot.start_rapid():
                self._refuse(400, WRONG_STATE)
                return
            if form["cycle"] != "asis":
                self.state.cycle = form["cycle"]
            self._answer(204)
        elif action == "stop" and form.get("stopmode") in ("cycle", "instr", "stop", "qstop"):
            if robot.mode == "AUTO":
                robot.stop_rapid()
            self._answer(204) if robot.mode == "AUTO" else self._refuse(403, REJECTED)
        else:
            self._refuse(400, INVALID)

    def _state(self, **values: str) -> None:
        self._states([values])

    def _states(self, values: list[dict[str, str]]) -> None:
        self._answer(200, {"_embedded": {"_state": values}})

    def _refuse(self, status: int, code: int) -> None:
        self._answer(status, {"_embedded": {"status": {"code": code, "msg": f"rws_twin code:{code}"}}})

    def _answer(self, status: int, content: object = None, **headers: str) -> None:
        body = b"" if content is None else json.dumps(content).encode()
        self.send_response(status)
        if self.opened is not None:
            self.send_header("Set-Cookie", f"{SESSION}={self.opened}; path=/; httponly")
            self.send_header("Set-Cookie", "ABBCX=1; path=/; httponly")
        if body:
            self.send_header("Content-Type", "application/json")
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _allowed(self) -> bool:
        """Check rate and session, or else digest access (RFC 2617), which opens a session; answer if something is wrong."""
        self.opened = None
        time.sleep(self.state.limits.delay)
        if not self.state.admit():
            self._answer(503)
            return False
        if self.state.resume(self._cookie()):
            return True
        given = self.headers.get("Authorization", "")
        if given.startswith("Digest "):
            fields = urllib.request.parse_keqv_list(urllib.request.parse_http_list(given.removeprefix("Digest ")))
            if fields.get("nonce") == self.state.nonce and fields.get("response") == self._digest(fields):
                self.opened = self.state.open()
                if self.opened is None:
                    self._answer(503)
                return self.opened is not None
        challenge = f'Digest realm="{REALM}", nonce="{self.state.nonce}", qop="auth", algorithm=MD5'
        self._answer(401, WWW_Authenticate=challenge)
        return False

    def _cookie(self) -> str | None:
        cookies = http.cookies.SimpleCookie(self.headers.get("Cookie", ""))
        return cookies[SESSION].value if SESSION in cookies else None

    def _digest(self, fields: dict[str, str]) -> str:
        def md5(*parts: str) -> str:
            return hashlib.md5(":".join(parts).encode()).hexdigest()

        secret = md5(USER, REALM, PASSWORD)
        request = md5(self.command, fields.get("uri", ""))
        return md5(
            secret, self.state.nonce, fields.get("nc", ""), fields.get("cnonce", ""), fields.get("qop", ""), request
        )

    def log_message(self, *_: object) -> None:
        """Log nothing."""


def _message(message: ControllerMessage) -> dict[str, str]:
    return {
        "_type": "elog-message-li",
        "_title": f"/rw/elog/0/{message.number}",
        "msgtype": str(message.kind),
        "code": str(message.code),
        "tstamp": message.time,
        "title": message.title,
        "desc": message.description,
    }
