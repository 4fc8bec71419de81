"""Questions to a person, each in a dialog of the window in which they are asked."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from nicegui import ui

__all__ = ["ask", "ask_for", "dialog"]


@contextlib.contextmanager
def dialog(name: str) -> Iterator[ui.dialog]:
    """A dialog with a name for screen readers. It belongs to the window, not to the button that opens it, which may be
    removed meanwhile. It is deleted once it has closed: only then the focus is back where it was."""
    with ui.context.client, ui.dialog() as opened, ui.card():
        opened.props["aria-label"] = name
        opened.on("hide", opened.delete)
        yield opened


async def ask(question: str, *, yes: str, testid: str) -> bool:
    """Ask a question and return whether the answer is yes."""
    with dialog(question) as asked:
        ui.label(question)
        with ui.row().classes("self-end gap-2"):
            ui.button("Cancel", on_click=lambda: asked.submit(False)).props("no-caps flat autofocus")
            ui.button(yes, on_click=lambda: asked.submit(True)).props(f"no-caps unelevated data-testid={testid}-yes")
    return bool(await asked)


async def ask_for(question: str, *, value: str, yes: str, testid: str) -> str | None:
    """Ask for a name and return it, None if the person cancels."""
    with dialog(question) as asked:
        field = ui.input(question, value=value).props(
            f"autofocus outlined dense data-testid={testid}-name maxlength=64"
        )
        field.classes("w-64").on("keydown.enter", lambda: asked.submit(field.value))
        with ui.row().classes("self-end gap-2"):
            ui.button("Cancel", on_click=lambda: asked.submit(None)).props("no-caps flat")
            ui.button(yes, on_click=lambda: asked.submit(field.value)).props(
                f"no-caps unelevated data-testid={testid}-yes"
            )
    return await asked
