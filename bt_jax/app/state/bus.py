"""Who is told of what: the parts of the state announce their changes, and every window hears of them."""

from __future__ import annotations

import dataclasses
import traceback
from collections import defaultdict
from collections.abc import Callable
from typing import Literal

__all__ = ["Bus", "Kind", "Message", "Topic"]

Topic = Literal[
    "task",
    "scene",
    "evolution",
    "tree",
    "demonstrations",
    "watching",
    "lesson",
    "player",
    "runs",
    "news",
    "notices",
    "holds",
    "trash",
    "robot",
    "correction",
]
Kind = Literal["info", "success", "warning", "error"]


@dataclasses.dataclass(frozen=True)
class Message:
    """A sentence for a person."""

    text: str = ""
    kind: Kind = "info"


class Bus:
    """Passes changes on to subscribers, on the event loop only. `news` is what was said last to all windows, since none of
    them has caused it; what one window has caused is said there."""

    def __init__(self) -> None:
        self.news = Message()
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

    def say(self, text: str, kind: Kind = "info") -> None:
        """Say one sentence in every window that is open."""
        self.news = Message(text, kind)
        self.changed("news")
