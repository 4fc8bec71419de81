"""A line that says which other window steers what this one shows, and until when."""

from __future__ import annotations

from nicegui import ui

from bt_jax.app.state.holds import Holds, Shared
from bt_jax.app.widgets.context import PageContext

__all__ = ["holder_line"]


def holder_line(holds: Holds, page: PageContext, thing: Shared) -> None:
    """Build the line into the container that is open; it is hidden while this window may steer the thing."""
    line = ui.label().classes("holder-line").props(f"role=status data-testid=holder-{thing}")

    def refresh() -> None:
        sentence = holds.sentence(thing, page.window)
        line.set_text(f"{sentence[:1].upper()}{sentence[1:]}.")
        line.set_visibility(bool(sentence))

    page.on("holds", refresh)
