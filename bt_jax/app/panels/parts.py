"""Pieces that panels are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from nicegui import ui
from nicegui.element import Element

from bt_jax._util.errors import UserError
from bt_jax.app.plain_words import Words
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.dialogs import ask
from bt_jax.tasks import Object, Task

__all__ = [
    "MOST",
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
    """Return a button with an icon; `more` are further Quasar props."""
    made = ui.button(text, icon=icon, on_click=handler).classes("part-button" if text else "")
    return mark(made.props(f"no-caps unelevated dense {more}"), testid)


def mark(element: E, testid: str, **props: str) -> E:
    """Set properties whose values may hold anything, such as names that a person has chosen; _ in a key stands for -."""
    element.props["data-testid"] = testid
    for key, value in props.items():
        element.props[key.replace("_", "-")] = value
    return element


def heading(text: str) -> ui.label:
    """Return the title of a part of a panel."""
    return ui.label(text).classes("part-heading").props("role=heading aria-level=2")


def css_color(thing: Object) -> str:
    """Return the colour of an object."""
    red, green, blue = (round(255 * part) for part in thing.color)
    return f"rgb({red} {green} {blue})"


def known(frame: str, task: Task, *, robot: str) -> str:
    """Return the everyday name of a frame; `robot` is the name of the robot's frame."""
    return robot if frame == task.robot_frame else Words(task).kit(frame) if frame in task.kit_names else frame


def whole_field(label: str, testid: str, value: int | None) -> ui.number:
    """Return a field for a whole number. It has no limits of its own: NiceGUI would replace what a person has written with
    the nearest number in the limits; `whole` says what is allowed instead."""
    return mark(ui.number(label, value=value, step=1).props("dense outlined"), testid)


def whole(field: ui.number, low: int, high: int) -> int:
    """Return the number in a field. Raise UserError if it is not a whole number from `low` to `high`."""
    value = field.value
    if value is None or value != int(value) or not low <= value <= high:
        name = field.props["label"].lower()
        raise UserError(f"{name} must be a whole number from {low:,} to {high:,}; write one into its field")
    return int(value)


async def may_leave(studio: Studio) -> bool:
    """Return whether another task may be opened: the changes of this one are saved, or a person discards them. Raise
    UserError if it is changed while they are asked."""
    task, start = studio.edited.task, studio.edited.start
    if not studio.unsaved:
        return True
    leaves = await ask(f"The changes of {task.name} are not saved.", yes="Discard them", testid="task-leave")
    if leaves and (studio.edited.task is not task or studio.edited.start is not start):
        raise UserError("the task was changed in another window meanwhile; look at it before you discard it")
    return leaves
