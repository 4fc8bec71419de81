"""Who is refreshed when: a part of a window that is shown at once, one that is hidden when it is shown again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

__all__ = ["Refreshing"]

Callback = Callable[[], Any]
Part = TypeVar("Part")


class Refreshing(Generic[Part]):
    """Refreshes the callbacks of a window with `call`. Each belongs to a part of the window, None for what is always shown;
    one part is `shown` at a time."""

    def __init__(self, call: Callable[[Callback], None], shown: Part) -> None:
        self.shown = shown
        self._call = call
        self._stale: dict[tuple[Part, Callback], None] = {}  # of hidden parts, in the order of their changes

    def notice(self, part: Part | None, callback: Callback) -> Callback:
        """Return what is to be called after a change that a callback shows."""

        def changed() -> None:
            if part is None or part == self.shown:
                self._call(callback)
            else:
                self._stale[part, callback] = None

        return changed

    def show(self, part: Part) -> None:
        """Show a part, and what has changed in it since it was hidden, each callback once."""
        self.shown = part
        due = [key for key in self._stale if key[0] == part]
        for key in due:
            del self._stale[key]
            self._call(key[1])
