"""The fields of a tray: name, size, place, a grid, and slots."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from nicegui import ui

from bt_jax.app.panels.kit.edits import Edits
from bt_jax.app.panels.kit.form import Form
from bt_jax.app.panels.parts import button, mark
from bt_jax.app.state.kit.moving import from_seen, seen
from bt_jax.app.state.kit.trays import add_slot, change_slot, change_tray, remove_slot, rename_tray, tray_of
from bt_jax.app.units import in_metres, in_millimetres
from bt_jax.tasks import Kit, Slot, Task

__all__ = ["TrayEditor"]


class TrayEditor:
    """Built into the container that is open; `renamed` is told the new name before the task has it. `adds_slots`: whether a
    click on the tray adds a slot."""

    def __init__(self, edits: Edits, name: str, renamed: Callable[[str], None], *, adds_slots: bool = False) -> None:
        self.edits, self.name, self._renamed = edits, name, renamed
        self.form, self.adds_slots = Form(edits), adds_slots
        self.shape = self._shape(edits.task)
        form, task = self.form, edits.task
        with ui.row().classes("items-center gap-2"):
            form.text("Name", "kit-name", lambda: self.name, self._rename)
            tables = {"": "any table"} | {table.name: table.name for table in task.tables}
            form.choice(
                "stands on", "kit-table", tables, lambda: self.kit.table, lambda table: self._change(table=table)
            )
        with ui.row().classes("items-center gap-2"):
            self._pair("size", ("wide, mm", "deep, mm"), "size", signed=False)
            form.number(
                "walls, mm",
                "kit-walls",
                lambda: in_millimetres(self.kit.wall_height),
                lambda value: self._change(wall_height=in_metres(value)),
            )
            self._pair("position", ("right, mm", "back, mm"), "place", signed=True)
        with ui.row().classes("items-center gap-2"):
            for i, label in enumerate(("rows", "columns")):
                form.number(label, f"kit-{label}", functools.partial(self._cells, i), self._grid(i), whole=True)
            form.tick("walls between", "kit-dividers", lambda: self.kit.dividers, lambda on: self._change(dividers=on))
        with ui.row().classes("items-center gap-2"):
            button("Add a slot", "kit-add-slot", "add", edits.guard(self._add_slot))
            ui.checkbox(
                "Click on the tray to add slots", value=adds_slots, on_change=lambda event: self._adds(event.value)
            ).props("dense data-testid=kit-click-slots")
        for slot in self.kit.slots:
            self._slot_row(slot)

    @property
    def kit(self) -> Kit:
        return tray_of(self.edits.task, self.name)

    def stays(self, task: Task, chosen: str) -> bool:
        """Return whether these are the fields of what is chosen."""
        return chosen == self.name and chosen in task.kit_names and self._shape(task) == self.shape

    def refresh(self) -> None:
        """Show the values as they are."""
        self.form.refresh()

    def _shape(self, task: Task) -> tuple[object, ...]:
        return tuple(slot.name for slot in tray_of(task, self.name).slots), task.kinds

    def _adds(self, on: bool) -> None:
        self.adds_slots = on

    def _change(self, **fields: Any) -> None:
        self.edits.studio.build(change_tray(self.edits.task, self.name, **fields))

    def _pair(self, field: str, labels: tuple[str, str], testid: str, *, signed: bool) -> None:
        """Add two fields for lengths to the right and away from a person who faces the robot."""

        def read(i: int) -> float:
            return in_millimetres(seen(self.edits.task, getattr(self.kit, field), signed=signed)[i])

        def change(i: int) -> Callable[[float], None]:
            def changed(value: float) -> None:
                both = [in_metres(value if i == k else read(k)) for k in (0, 1)]
                self._change(**{field: from_seen(self.edits.task, (both[0], both[1]), signed=signed)})

            return changed

        for i, label in enumerate(labels):
            self.form.number(label, f"kit-{testid}-{label.partition(',')[0]}", functools.partial(read, i), change(i))

    def _cells(self, i: int) -> int:
        return (self.kit.grid or (0, 0))[i]

    def _grid(self, i: int) -> Callable[[float], None]:
        def change(value: float) -> None:
            grid = [int(value) if i == k else (self.kit.grid or (1, 1))[k] for k in (0, 1)]
            self._change(grid=None if int(value) == 0 else (grid[0], grid[1]))

        return change

    def _add_slot(self) -> None:
        self.edits.studio.build(add_slot(self.edits.task, self.name, (0.0, 0.0))[0])

    def _slot_row(self, slot: Slot) -> None:
        name, edits = slot.name, self.edits

        def now() -> Slot:
            return next(one for one in self.kit.slots if one.name == name)

        def change(**fields: Any) -> None:
            edits.studio.build(change_slot(edits.task, self.name, name, **fields))

        def at(i: int) -> float:
            return in_millimetres(seen(edits.task, now().position, signed=True)[i])

        def place(i: int) -> Callable[[float], None]:
            def changed(value: float) -> None:
                both = [in_metres(value if i == k else at(k)) for k in (0, 1)]
                change(position=from_seen(edits.task, (both[0], both[1]), signed=True))

            return changed

        with ui.row().classes("items-center gap-2 no-wrap kit-slot"):
            self.form.text("slot", f"kit-slot-{name}", lambda: name, lambda new: change(name=new.strip()))
            for i, label in enumerate(("right", "back")):
                self.form.number(
                    f"{label}, mm",
                    f"kit-slot-{name}-{label}",
                    functools.partial(at, i),
                    place(i),
                    called=f"slot {name}, {label}, mm",
                )
            self.form.number(
                "turned, °",
                f"kit-slot-{name}-turn",
                lambda: now().turn,
                lambda turn: change(turn=turn),
                called=f"slot {name}, turned",
            )
            options = {"": "anything"} | {kind: kind for kind in edits.task.kinds}
            self.form.choice(
                "for", f"kit-slot-{name}-for", options, lambda: now().takes, lambda kind: change(takes=kind)
            )
            remove = ui.button(
                icon="close",
                on_click=edits.guard(lambda: edits.studio.build(remove_slot(edits.task, self.name, name))),
            ).props("flat dense size=sm")
            mark(remove, f"kit-slot-{name}-remove", aria_label=f"Remove slot {name}")

    def _rename(self, name: str) -> None:
        task = rename_tray(self.edits.task, self.name, name.strip())
        before, self.name = self.name, name.strip()
        self._renamed(self.name)
        try:
            self.edits.studio.build(task)
        except BaseException:
            self.name = before
            self._renamed(before)
            raise
