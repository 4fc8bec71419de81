"""Fields for what a person builds: each shows a value of the task, and changes the task when it is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.kit.edits import Edits
from bt_jax.app.panels.parts import mark

__all__ = ["Form"]

APPLY = ("blur", "keydown.enter", "keyup.up", "keyup.down")
CHOSEN = "update:model-value"  # sent for choices of a person only, not for changes by the program


class Form:
    """A group of fields. `read` returns what a field shows, `change` makes a task of what was written; after a UserError the
    field shows the value as it was."""

    def __init__(self, edits: Edits) -> None:
        self._edits = edits
        self._fields: list[tuple[Any, Callable[[], Any]]] = []

    def refresh(self) -> None:
        """Show the values as they are; a field that somebody is writing in stays if its value is the same."""
        for field, read in self._fields:
            field.set_value(read())

    def text(self, label: str, testid: str, read: Callable[[], str], change: Callable[[str], None]) -> None:
        """Add a field for a name."""
        self._left(mark(ui.input(label).props("dense outlined maxlength=64"), testid).classes("kit-name"), read, change)

    def number(
        self,
        label: str,
        testid: str,
        read: Callable[[], float | None],
        change: Callable[[float], None],
        *,
        called: str = "",
        whole: bool = False,
    ) -> None:
        """Add a field for a number, which is shown with one decimal unless it is `whole`; `called` is its full name."""
        field = ui.number(label, step=1, format="%d" if whole else "%g").props("dense outlined").classes("place-number")
        mark(field, testid, aria_label=called or label)

        def written(value: float | None) -> None:
            if value is None:
                raise UserError(f"a number is missing for {called or label}; write one")
            change(float(value))

        self._left(field, lambda: _rounded(read()), written)

    def choice(
        self, label: str, testid: str, options: dict[Any, str], read: Callable[[], Any], change: Callable[[Any], None]
    ) -> None:
        """Add a menu."""
        menu = mark(ui.select(options, label=label).props("dense outlined options-dense"), testid).classes("kit-choice")
        self._add(menu, (CHOSEN,), read, change)

    def tick(self, label: str, testid: str, read: Callable[[], bool], change: Callable[[bool], None]) -> None:
        """Add a box to tick."""
        self._add(mark(ui.checkbox(label).props("dense"), testid), (CHOSEN,), read, change)

    def _left(self, field: Any, read: Callable[[], Any], change: Callable[[Any], None]) -> None:
        self._add(field, APPLY, read, change)

    def _add(self, field: Any, events: Sequence[str], read: Callable[[], Any], change: Callable[[Any], None]) -> None:
        def apply() -> None:
            if field.value != read():
                try:
                    change(field.value)
                finally:
                    field.set_value(read())

        field.set_value(read())
        for event in events:
            field.on(event, self._edits.guard(apply))
        self._fields.append((field, read))


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 1) + 0.0
