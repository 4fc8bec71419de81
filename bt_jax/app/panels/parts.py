"""Pieces that panels are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from nicegui import ui
from nicegui.element import Element

from bt_jax.errors import UserError

__all__ = ["ask", "ask_for", "button", "heading", "mark", "whole", "whole_field"]

E = TypeVar("E", bound=Element)


def button(text: str, testid: str, icon: str, handler: Callable[..., Any], *, more: str = "") -> ui.button:
    """A button with an icon; `more` are further Quasar props."""
    made = ui.button(text or None, icon=icon, on_click=handler).classes("part-button" if text else "")
    return mark(made.props(f"no-caps unelevated dense {more}"), testid)


def mark(element: E, testid: str, **props: str) -> E:
    """Sets properties whose values may hold anything, such as names that a person has chosen; _ in a key stands for -."""
    element.props["data-testid"] = testid
    for key, value in props.items():
        element.props[key.replace("_", "-")] = value
    return element


def heading(text: str) -> ui.label:
    """The title of a part of a panel."""
    return ui.label(text).classes("part-heading").props("role=heading aria-level=2")


def whole_field(label: str, testid: str, value: int) -> ui.number:
    """A field for a whole number. It has no limits of its own: NiceGUI would put the nearest number in place of what a
    person has written, unasked; `whole` says instead what can be."""
    return mark(ui.number(label, value=value, step=1).props("dense outlined"), testid)


def whole(field: ui.number, low: int, high: int) -> int:
    """What the field says. Raises UserError where that is no whole number from `low` to `high`."""
    value = field.value
    if value is None or value != int(value) or not low <= value <= high:
        name = field.props["label"].lower()
        raise UserError(f"{name} must be a whole number from {low:,} to {high:,}; write one into its field")
    return int(value)


async def ask(question: str, *, yes: str, testid: str) -> bool:
    """Whether a person says yes to something that cannot be taken back."""
    with ui.dialog() as dialog, ui.card():
        ui.label(question)
        with ui.row().classes("self-end gap-2"):
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("no-caps flat autofocus")
            ui.button(yes, on_click=lambda: dialog.submit(True)).props(f"no-caps unelevated data-testid={testid}-yes")
    answer = await dialog
    dialog.delete()
    return bool(answer)


async def may_leave(studio: Studio) -> bool:
    """Whether another task may take the place of this one: its changes are saved, or a person lets them go."""
    if not studio.unsaved:
        return True
    return await ask(f"The changes of {studio.task.name} are not saved.", yes="Discard them", testid="task-leave")


async def ask_for(question: str, *, value: str, yes: str, testid: str) -> str | None:
    """A name that a person types, None where they would rather not."""
    with ui.dialog() as dialog, ui.card():
        field = ui.input(question, value=value).props(
            f"autofocus outlined dense data-testid={testid}-name maxlength=64"
        )
        field.classes("w-64").on("keydown.enter", lambda: dialog.submit(field.value))
        with ui.row().classes("self-end gap-2"):
            ui.button("Cancel", on_click=lambda: dialog.submit(None)).props("no-caps flat")
            ui.button(yes, on_click=lambda: dialog.submit(field.value)).props(
                f"no-caps unelevated data-testid={testid}-yes"
            )
    answer = await dialog
    dialog.delete()
    return answer
