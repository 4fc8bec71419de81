"""A controller that only Robot Web Services know: no arms, no physics; it may be made to misbehave."""

import contextlib
import threading
import time

from bt_jax.deploy.link.rws import (
    EGM_REQUEST,
    EGM_STATE,
    GRIP_ACTUAL,
    GRIP_FORCE,
    GRIP_TARGET,
    ControllerMessage,
    Rws,
    symbol,
)
from bt_jax.deploy.twin.rws_server import PASSWORD, USER, RwsLimits, serve_rws

NAMES = (EGM_REQUEST, EGM_STATE, GRIP_ACTUAL, GRIP_FORCE, GRIP_TARGET)


class FakeController:
    """`stops` False: it answers that it stops and runs on; `hang`: seconds for which every request is held up."""

    def __init__(self) -> None:
        self.control, self.mode, self.rapid = "motoron", "AUTO", True
        self.messages = [ControllerMessage(1, 1, 10151, "Program started")]
        self.numbers = {symbol(arm, name): 0.0 for arm in ("left", "right") for name in NAMES}
        self.stops, self.hang = True, 0.0
        self.stop_requests = 0
        self.free = threading.Event()  # ends a hang

    def start_rapid(self) -> bool:
        self.rapid = self.control == "motoron" and self.mode == "AUTO"
        return self.rapid

    def stop_rapid(self) -> None:
        self.free.wait(self.hang)
        self.stop_requests += 1
        self.rapid = self.rapid and not self.stops

    def number(self, url: str) -> float:
        self.free.wait(self.hang)
        return self.numbers[url]

    def set_number(self, url: str, value: float) -> None:
        if url not in self.numbers:
            raise KeyError(url)
        self.numbers[url] = value


@contextlib.contextmanager
def served(limits: RwsLimits | None = None):
    """A controller and its server: (controller, server). Every request is noted in `server.requests`: (time, line)."""
    controller = FakeController()
    server = serve_rws(controller, 0, limits)
    server.requests = []
    answer = server.RequestHandlerClass.send_response

    def note(handler, code, *rest):
        server.requests.append((time.monotonic(), f"{handler.command} {handler.path.partition('?')[0]} {code}"))
        answer(handler, code, *rest)

    server.RequestHandlerClass.send_response = note
    try:
        yield controller, server
    finally:
        controller.free.set()
        server.shutdown()
        server.server_close()


def client(server, **options) -> Rws:
    """Return a session with a server."""
    return Rws("127.0.0.1", server.server_address[1], USER, options.pop("password", PASSWORD), **options)
