"""The token that a page asks for if others can reach it, and the logins that it gives for it."""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Callable

__all__ = ["LOGIN_HOURS", "Logins", "new_token"]

LOGIN_HOURS = 12.0
WRONG_TOKENS, WRONG_SECONDS = 5, 60.0  # from one address, until it has to wait


def new_token() -> str:
    """Return a token that nobody guesses, short enough to be typed."""
    return secrets.token_hex(8)


class Logins:
    """Who has shown the token. A login lasts `LOGIN_HOURS`; all end with the server. Times are of `clock`, seconds."""

    def __init__(self, token: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._token, self._clock = token, clock
        self._ends: dict[str, float] = {}
        self._wrong: dict[str, deque[float]] = {}

    def log_in(self, token: str, address: str) -> str | None:
        """Return the key of a new login, None if the token is wrong."""
        now = self._clock()
        if not secrets.compare_digest(token.strip().encode(), self._token.encode()):
            self._wrong.setdefault(address, deque(maxlen=WRONG_TOKENS)).append(now)
            return None
        self._ends = {key: ends for key, ends in self._ends.items() if ends > now}
        key = secrets.token_urlsafe(32)
        self._ends[key] = now + 3600 * LOGIN_HOURS
        return key

    def wait(self, address: str) -> float:
        """Return for how long an address has to wait before it may try another token, seconds."""
        now = self._clock()
        self._wrong = {who: times for who, times in self._wrong.items() if times[-1] > now - WRONG_SECONDS}
        times = self._wrong.get(address)
        return 0.0 if times is None or len(times) < WRONG_TOKENS else times[0] + WRONG_SECONDS - now

    def left(self, key: str) -> float:
        """Return for how long a login still lasts, seconds; 0 if there is none with this key."""
        return max(0.0, self._ends.get(key, 0.0) - self._clock())
