"""The line at the foot of a window: what was said there last, until the next thing that succeeds there."""

from __future__ import annotations

from nicegui import ui

from bt_jax.app.state.bus import Message

__all__ = ["MessageLine"]

ICONS = {"info": "info", "success": "check_circle", "warning": "warning", "error": "error"}


class MessageLine:
    """Built into the container that is open. `count` grows with every message."""

    def __init__(self) -> None:
        self.count = 0
        self._refused = False  # whether it says that something which was tried here has failed
        with ui.element("div").classes("message") as self._line:
            self._icon = ui.icon("info").props("aria-hidden=true")
            self._text = ui.label().classes("message-text").props("data-testid=message")
            self._close = ui.button(icon="close", on_click=self.clear).props(
                'flat dense round size=sm aria-label="Close this message" data-testid=message-close'
            )
        self.clear()

    def say(self, message: Message) -> None:
        """Say what has come of something that was done in this window."""
        self._refused = message.kind == "error"
        self._show(message)

    def hear(self, news: Message) -> None:
        """Say what concerns every window, unless an error of this one would be lost."""
        if not self._refused:
            self._show(news)

    def clear(self) -> None:
        """Say nothing any more."""
        self._refused = False
        self._show(Message())

    def _show(self, message: Message) -> None:
        self.count += 1
        self._text.set_text(message.text)
        self._text.props(f"role={'alert' if message.kind in ('warning', 'error') else 'status'}")
        self._icon.set_name(ICONS[message.kind])
        self._line.props["data-kind"] = message.kind if message.text else ""
        self._line.update()
        self._icon.set_visibility(bool(message.text))
        self._close.set_visibility(bool(message.text))
