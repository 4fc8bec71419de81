"""The robot's side of Robot Web Services, for the twin: the same addresses, answers and digest access as `rws` expects."""

from __future__ import annotations

import hashlib
import http.server
import json
import secrets
import threading
import urllib.parse
import urllib.request
from typing import Protocol, runtime_checkable

__all__ = ["PASSWORD", "USER", "Controlled", "serve_rws"]

USER, PASSWORD = "Default User", "robotics"  # as a controller is delivered
REALM = "validusers@robapi.abb"
SYMBOLS = "/rw/rapid/symbol/data/"


@runtime_checkable
class Controlled(Protocol):
    """What the requests act on; called from the server's threads."""

    control: str  # motoron ...
    mode: str  # AUTO ...

    @property
    def rapid(self) -> bool: ...

    def start_rapid(self) -> bool: ...

    def stop_rapid(self) -> None: ...

    def number(self, url: str) -> float: ...  # KeyError where there is no such symbol

    def set_number(self, url: str, value: float) -> None: ...


def serve_rws(controlled: Controlled, port: int) -> http.server.ThreadingHTTPServer:
    """Serve on the loopback interface in threads of this process; port 0 takes any free one."""
    handler = type("Handler", (_Handler,), {"controlled": controlled, "nonce": secrets.token_hex(16)})
    server = http.server.ThreadingHTTPServer(("127.0.0.1", port), handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


class _Handler(http.server.BaseHTTPRequestHandler):
    controlled: Controlled
    nonce: str
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        if not self._allowed():
            return
        path = urllib.parse.urlsplit(self.path).path
        robot = self.controlled
        if path == "/rw/panel/ctrlstate":
            self._state(ctrlstate=robot.control)
        elif path == "/rw/panel/opmode":
            self._state(opmode=robot.mode)
        elif path == "/rw/rapid/execution":
            self._state(ctrlexecstate="running" if robot.rapid else "stopped")
        elif path.startswith(SYMBOLS):
            try:
                self._state(value=f"{robot.number(path.removeprefix(SYMBOLS)):g}")
            except KeyError:
                self._answer(404)
        else:
            self._answer(404)

    def do_POST(self) -> None:
        form = urllib.parse.parse_qs(self.rfile.read(int(self.headers.get("Content-Length") or 0)).decode())
        if not self._allowed():
            return
        url = urllib.parse.urlsplit(self.path)
        action = urllib.parse.parse_qs(url.query).get("action", [""])[0]
        robot = self.controlled
        if url.path == "/rw/rapid/execution" and action == "resetpp":
            self._answer(403 if robot.rapid else 204)
        elif url.path == "/rw/rapid/execution" and action == "start":
            self._answer(204 if robot.start_rapid() else 403)
        elif url.path == "/rw/rapid/execution" and action == "stop":
            robot.stop_rapid()
            self._answer(204)
        elif url.path.startswith(SYMBOLS) and action == "set":
            try:
                robot.set_number(url.path.removeprefix(SYMBOLS), float(form["value"][0]))
                self._answer(204)
            except KeyError:
                self._answer(404)
            except ValueError:
                self._answer(400)
        else:
            self._answer(400)

    def _state(self, **values: str) -> None:
        self._answer(200, json.dumps({"_embedded": {"_state": [values]}}).encode())

    def _answer(self, code: int, body: bytes = b"", **headers: str) -> None:
        self.send_response(code)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _allowed(self) -> bool:
        """Check digest access (RFC 2617); ask for it if it is missing or wrong."""
        given = self.headers.get("Authorization", "")
        if given.startswith("Digest "):
            fields = urllib.request.parse_keqv_list(urllib.request.parse_http_list(given.removeprefix("Digest ")))
            if fields.get("nonce") == self.nonce and fields.get("response") == self._digest(fields):
                return True
        challenge = f'Digest realm="{REALM}", nonce="{self.nonce}", qop="auth", algorithm=MD5'
        self._answer(401, WWW_Authenticate=challenge)
        return False

    def _digest(self, fields: dict[str, str]) -> str:
        def md5(*parts: str) -> str:
            return hashlib.md5(":".join(parts).encode()).hexdigest()

        secret = md5(USER, REALM, PASSWORD)
        request = md5(self.command, fields.get("uri", ""))
        return md5(secret, self.nonce, fields.get("nc", ""), fields.get("cnonce", ""), fields.get("qop", ""), request)

    def log_message(self, *_: object) -> None:
        """Log nothing."""
