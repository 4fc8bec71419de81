"""The twin's network: its ports, and a cable that can lose, delay and reorder messages in both directions."""

from __future__ import annotations

import contextlib
import random
import socket
from collections.abc import Collection

from bt_jax._util.errors import UserError

__all__ = ["Network", "free_ports"]

PORTS = range(
    20_000, 32_000
)  # below those that systems hand out themselves, so that no other socket gets one meanwhile
TRIES = 1000


def free_ports(arms: Collection[str]) -> dict[str, int]:
    """Return a UDP port for each arm that nobody uses now. Raise UserError if there are none."""
    found: list[int] = []
    for port in random.SystemRandom().sample(PORTS, TRIES):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
            probe.bind(("", port))
            found.append(port)
        if len(found) == len(arms):
            return dict(zip(arms, found, strict=True))
    raise UserError("no UDP port is free; end programs that use the network")


class Network:
    """One UDP connection of the controller to its client. Times are the controller's."""

    def __init__(self, link: socket.socket, peer: tuple[str, int]) -> None:
        self._socket, self._peer = link, peer
        self._random = random.Random(0)
        self._drop = self._reorder = self._delay = 0.0
        self._silent_until = -1.0
        self._underway: list[tuple[float, bytes]] = []  # when to send, message
        self._held: bytes | None = None  # waits to be overtaken

    @property
    def broken(self) -> bool:
        """May messages be lost, delayed or reordered?"""
        return bool(self._drop or self._reorder or self._delay or self._silent_until > 0)

    def fault(self, kind: str, now: float, *, share: float = 0.0, seconds: float = 0.0) -> None:
        """`drop` and `reorder` a share of the messages, `delay` all by seconds, `silence` for seconds, or `heal`."""
        if kind == "heal":
            self._drop = self._reorder = self._delay = 0.0
            self._silent_until = -1.0
        elif kind == "drop":
            self._drop = share
        elif kind == "reorder":
            self._reorder = share
        elif kind == "delay":
            self._delay = seconds
        elif kind == "silence":
            self._silent_until = now + seconds
        else:
            raise ValueError(f"there is no fault '{kind}'")

    def send(self, message: bytes, now: float) -> None:
        """Send a message, as far as the faults permit."""
        if now >= self._silent_until and self._random.random() >= self._drop:
            if self._held is None and self._random.random() < self._reorder:
                self._held = message
            else:
                self._underway.append((now + self._delay, message))
                if self._held is not None:
                    self._underway.append((now + self._delay, self._held))
                    self._held = None
        while self._underway and self._underway[0][0] <= now + 1e-9:
            message = self._underway.pop(0)[1]
            with contextlib.suppress(OSError):  # nobody listens there yet
                self._socket.sendto(message, self._peer)

    def receive(self, now: float) -> list[bytes]:
        """Return the messages that have arrived, as far as the faults permit."""
        found: list[bytes] = []
        while True:
            try:
                message = self._socket.recv(4096)
            except OSError:
                return found
            if now >= self._silent_until and self._random.random() >= self._drop:
                found.append(message)
