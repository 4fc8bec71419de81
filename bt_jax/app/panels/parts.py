"""Pieces that panels are made of."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from nicegui import ui
from nicegui.element import Element

from bt_jax._util.errors import UserError
from bt_jax.app.state.studio import Studio
from bt_jax.tasks import Box, Task

__all__ = [
    "MOST",
    "ask",
    "ask_for",
    "button",
    "css_color",
    "heading",
    "known",
    "mark",
    "may_leave",
    "whole",
    "whole_field",
]

MOST = 100_000  # trees of a population, and generations

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


def css_color(box: Box) -> str:
    """The colour of a box."""
    red, green, blue = (round(255 * part) for part in box.color)
    return f"rgb({red} {green} {blue})"


def known(frame: str, task: Task, *, robot: str) -> str:
    """What a person calls a frame; `robot` is what that of the robot is called."""
    return {task.kit.name: "the kit", task.robot_frame: robot}.get(frame, frame)


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


@contextlib.contextmanager
def _dialog() -> Iterator[ui.dialog]:
    """A dialog of its window, not of the button that opens it, which may go meanwhile. It goes itself once it has closed:
    only then the focus is back where it was."""
    with ui.context.client, ui.dialog() as dialog, ui.card():
        dialog.on("hide", dialog.delete)
        yield dialog


async def ask(question: str, *, yes: str, testid: str) -> bool:
    """Whether a person says yes to something that cannot be taken back."""
    with _dialog() as dialog:
        ui.label(question)
        with ui.row().classes("self-end gap-2"):
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("no-caps flat autofocus")
            ui.button(yes, on_click=lambda: dialog.submit(True)).props(f"no-caps unelevated data-testid={testid}-yes")
    return bool(await dialog)


async def may_leave(studio: Studio) -> bool:
    """Whether another task may take the place of this one: its changes are saved, or a person lets them go."""
    if not studio.unsaved:
        return True
    return await ask(f"The changes of {studio.task.name} are not saved.", yes="Discard them", testid="task-leave")


async def ask_for(question: str, *, value: str, yes: str, testid: str) -> str | None:
    """A name that a person types, None where they would rather not."""
    with _dialog() as dialog:
        field = ui.input(question, value=value).props(
            f"autofocus outlined dense data-testid={testid}-name maxlength=64"
        )
        field.classes("w-64").on("keydown.enter", lambda: dialog.submit(field.value))
        with ui.row().classes("self-end gap-2"):
            ui.button("Cancel", on_click=lambda: dialog.submit(None)).props("no-caps flat")
            ui.button(yes, on_click=lambda: dialog.submit(field.value)).props(
                f"no-caps unelevated data-testid={testid}-yes"
            )
    return await dialog
