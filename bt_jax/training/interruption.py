"""Ctrl-C and SIGTERM during a training."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

__all__ = ["Interruption"]

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """While this context is open, the first Ctrl-C or SIGTERM raises KeyboardInterrupt and the next ones are ignored until
    `heed`; the handlers of before come back at its end.

    Python swallows exceptions in some places, such as destructors: `check` raises one that was lost there. A signal that was
    ignored before still is, and outside the main thread, where Python allows no handlers, none is changed.
    """

    def __init__(self) -> None:
        self._asked = self._ignored = False
        self._before: dict[signal.Signals, object] = {}

    def __enter__(self) -> Interruption:
        self._asked = self._ignored = False
        if threading.current_thread() is threading.main_thread():
            handlers = {number: signal.getsignal(number) for number in SIGNALS}
            self._before = {number: handler for number, handler in handlers.items() if handler is not signal.SIG_IGN}
            for number in self._before:
                signal.signal(number, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]  # what getsignal gave

    def check(self) -> None:
        """Raise KeyboardInterrupt if there was a signal."""
        if self._asked:
            raise KeyboardInterrupt

    def ignore(self) -> None:
        """Ignore the signals from now on, for what must not be lost."""
        self._ignored = True

    def heed(self) -> None:
        """Let the next signal raise KeyboardInterrupt."""
        self._ignored = False

    @contextlib.contextmanager
    def ignored(self) -> Iterator[None]:
        """Ignore the signals for a while."""
        before, self._ignored = self._ignored, True
        try:
            yield
        finally:
            self._ignored = before

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if not self._ignored:
            self._asked = self._ignored = True
            raise KeyboardInterrupt
