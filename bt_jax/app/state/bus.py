"""Who is told of what: the parts of the state announce their changes, and every window hears of them."""

from __future__ import annotations

import traceback
from collections import defaultdict
from collections.abc import Callable
from typing import Literal

__all__ = ["Bus", "Topic"]

Topic = Literal["task", "scene", "evolution", "tree", "demonstrations", "lesson", "player", "runs", "message"]


class Bus:
    """Passes changes on to subscribers, on the event loop only. `message` is the sentence in the footer of every window."""

    def __init__(self) -> None:
        self.message = ""
        self._subscribers: dict[Topic, list[Callable[[], None]]] = defaultdict(list)

    def subscribe(self, topic: Topic, callback: Callable[[], None]) -> Callable[[], None]:
        """Call back after each change of a topic. Return a function that ends the subscription."""
        self._subscribers[topic].append(callback)
        return lambda: self._subscribers[topic].remove(callback)

    def changed(self, *topics: Topic) -> None:
        """Tell all subscribers; if one fails, the others are still told."""
        for topic in topics:
            for callback in list(self._subscribers[topic]):
                try:
                    callback()
                except Exception:
                    traceback.print_exc()

    def say(self, message: str) -> None:
        """Show one sentence in the footer of every window."""
        self.message = message
        self.changed("message")
