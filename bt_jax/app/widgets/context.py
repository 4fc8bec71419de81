"""What a widget sees of the window that it is in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

from bt_jax.app.state.bus import Kind, Topic
from bt_jax.app.state.holds import Shared, Window
from bt_jax.app.state.steps import STEPS, Step

__all__ = ["STEPS", "PageContext", "Step"]


@runtime_checkable
class PageContext(Protocol):
    """One window of the page."""

    @property
    def window(self) -> Window:
        """Which window it is."""

    @property
    def step(self) -> Step:
        """The step that is shown."""

    def on(self, topic: Topic, callback: Callable[[], Any], *, now: bool = True) -> None:
        """Call back in this window after each change, as long as it is open, and at once if `now`; the function may be a
        coroutine. What a panel asks for while it is built waits until that panel is shown."""

    def on_step(self, callback: Callable[[Step], Any]) -> None:
        """Call back whenever this window shows another step; the function may be a coroutine."""

    def go(self, step: Step) -> None:
        """Show another step in this window."""

    def say(self, text: str, kind: Kind = "info") -> None:
        """Say one sentence in this window."""

    def guard(self, handler: Callable[..., Any], *, steers: Shared | None = None) -> Callable[..., Any]:
        """Return a handler of what a person does in this window: an error is said there as a sentence, and what was said
        before goes with the next success. It is called only if no other window steers the same thing."""

    def steer(self, thing: Shared) -> None:
        """Steer something that all windows share. Raise UserError if another window does."""

    def let_go(self) -> None:
        """Let other windows steer what this one has steered."""
