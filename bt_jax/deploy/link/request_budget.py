"""How often a controller is asked: one request at a time, commands first, and few enough in a second."""

from __future__ import annotations

import collections
import contextlib
import threading
import time
from collections.abc import Iterator

__all__ = ["RATE", "RequestBudget"]

RATE = 10
"""Requests a second, in all. An IRC5 answers 503 when it is asked more than about 20 times a second: the figure of one
public client, and no promise of the manual."""


class RequestBudget:
    """Turns of the threads that share a controller.

    No second sees more than `rate` requests. Readings keep 1/`rate` seconds from each other; a command goes before all
    readings that wait, as soon as the second has room. Without a rate (where time is simulated), turns are only taken one
    after the other.
    """

    def __init__(self, rate: int | None = RATE) -> None:
        self.rate = rate
        self._changed = threading.Condition()
        self._sent: collections.deque[float] = collections.deque()  # of the last second, `time.monotonic()`
        self._taken = False
        self._commands = 0  # that wait

    @contextlib.contextmanager
    def turn(self, *, command: bool = False) -> Iterator[None]:
        """Wait for the turn of one request, and hold it while it is answered."""
        with self._changed:
            self._commands += command
            try:
                while True:
                    left = self._left(command)
                    if not self._taken and left <= 0 and (command or not self._commands):
                        break
                    self._changed.wait(left if left > 0 else None)
            finally:
                self._commands -= command
            self._taken = True
        try:
            yield
        finally:
            with self._changed:
                self._taken = False
                self._changed.notify_all()

    def count(self) -> None:
        """Count a request that leaves now."""
        with self._changed:
            self._sent.append(time.monotonic())

    def _left(self, command: bool) -> float:
        """Return the seconds until the next request may leave."""
        if self.rate is None:
            return 0.0
        now = time.monotonic()
        while self._sent and self._sent[0] <= now - 1:
            self._sent.popleft()
        room = self._sent[-self.rate] + 1 - now if len(self._sent) >= self.rate else 0.0
        apart = 0.0 if command or not self._sent else self._sent[-1] + 1 / self.rate - now
        return max(room, apart)
