"""What every window says until somebody has taken note of it: what was brought back when the page was started."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from bt_jax.app.state.bus import Bus
from bt_jax.app.state.holds import Shared

__all__ = ["Discard", "Notice", "Notices"]


@dataclasses.dataclass(frozen=True)
class Discard:
    """What discards something that all windows share, which may be a coroutine function; a person is asked the `question`
    before, in a window that `steers` it."""

    do: Callable[[], Any]
    question: str
    steers: Shared


@dataclasses.dataclass(frozen=True, eq=False)
class Notice:
    """A sentence, and how to discard that of which it tells, None if nothing can be discarded."""

    text: str
    discard: Discard | None = None


class Notices:
    """`standing` are the notices that stand, the oldest first. Changes are announced under the topic "notices"."""

    def __init__(self, bus: Bus) -> None:
        self.standing: tuple[Notice, ...] = ()
        self._bus = bus

    def add(self, notice: Notice) -> None:
        """Let a notice stand."""
        self.standing += (notice,)
        self._bus.changed("notices")

    def remove(self, notice: Notice | None) -> None:
        """Take a notice away, if it still stands."""
        if notice in self.standing:
            self.standing = tuple(other for other in self.standing if other is not notice)
            self._bus.changed("notices")
