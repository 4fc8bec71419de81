"""What there is: objects and trays to add, choose, change, copy and remove."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from nicegui import ui

from bt_jax.app.panels.kit.edits import Edits
from bt_jax.app.panels.kit.object_editor import ObjectEditor
from bt_jax.app.panels.kit.tray_editor import TrayEditor
from bt_jax.app.panels.parts import button, css_color, mark
from bt_jax.app.state.kit.moving import moved_tray, point_in_tray
from bt_jax.app.state.kit.objects import add_object, copy_object, remove_object
from bt_jax.app.state.kit.trays import add_slot, add_tray, copy_tray, remove_tray
from bt_jax.tasks import Task

__all__ = ["Things"]


class Things:
    """Built into the container that is open. One thing is chosen, whose fields are shown."""

    def __init__(self, edits: Edits) -> None:
        self.edits, self.studio = edits, edits.studio
        self.chosen = ""
        self.shape: tuple[object, ...] = ()
        self.editor: ObjectEditor | TrayEditor | None = None
        guard = edits.guard
        with ui.element("div").classes("kit") as self.element:
            with ui.row().classes("items-center gap-2"):
                button("Box", "kit-add-box", "add", guard(lambda: self._new(add_object(edits.task, "cuboid"))))
                button("Can", "kit-add-can", "add", guard(lambda: self._new(add_object(edits.task, "cylinder"))))
                button("Tray", "kit-add-tray", "add", guard(lambda: self._new(add_tray(edits.task))))
            self.list = ui.row().classes("kit-list").props('role=group aria-label="What there is"')
            with ui.row().classes("items-center gap-2"):
                copy = button("Duplicate", "kit-copy", "content_copy", guard(self._copy), more="outline")
                remove = button("Remove", "kit-remove", "delete", guard(self._remove), more="outline")
            self.needed = (copy, remove)
            self.form = ui.element("div").classes("kit-form")

    def refresh(self) -> None:
        """Show what there is; fields stay as long as the thing does, so that the focus does, too."""
        task = self.edits.task
        if self.chosen not in (*task.kinds, *task.kit_names):
            self.chosen = task.kinds[0]
        shown = [(kind, len(task.instances[kind]), css_color(task.thing(kind))) for kind in task.kinds]
        shape = (shown, task.kit_names, self.chosen)
        if shape != self.shape:
            self.shape = shape
            self._build_list(task)
        self._edit(task)

    async def drop(self, name: str, position: Float[np.ndarray, "3"]) -> None:
        """Move an object, or a tray with what stands in it."""
        self.chosen = self._kind(name)
        if name in self.edits.task.kit_names:
            self.studio.build(moved_tray(self.edits.task, self.studio.edited.start, name, position))
        else:
            await self.edits.drop(name, position)

    def point(self, name: str, position: Float[np.ndarray, "3"]) -> None:
        """Choose what was clicked, or add a slot where a tray was clicked that is given slots."""
        editor = self.editor
        if isinstance(editor, TrayEditor) and editor.adds_slots and name == self.chosen:
            task, start = self.edits.task, self.studio.edited.start
            self.studio.build(add_slot(task, name, point_in_tray(task, start, name, position))[0])
            return
        self._choose(self._kind(name))

    def _kind(self, name: str) -> str:
        task = self.edits.task
        return name if name in task.kit_names else task.thing(name).part or name

    def _choose(self, name: str) -> None:
        self.chosen = name
        self.refresh()

    def _build_list(self, task: Task) -> None:
        self.list.clear()
        with self.list:
            for kind in task.kinds:
                count = len(task.instances[kind])
                with self._entry(kind):
                    ui.element("span").classes("task-chip").style(f"background: {css_color(task.thing(kind))}")
                    ui.label(kind + (f" \N{MULTIPLICATION SIGN} {count}" if count > 1 else ""))
            for name in task.kit_names:
                with self._entry(name):
                    ui.icon("inbox", size="18px")
                    ui.label(name)

    def _entry(self, name: str) -> ui.element:
        entry = ui.element("button").classes("kit-entry").on("click", lambda: self._choose(name), [])
        return mark(entry, f"kit-thing-{name}", aria_pressed=str(name == self.chosen).lower(), type="button")

    def _edit(self, task: Task) -> None:
        """Show the fields of the chosen thing."""
        if self.editor is None or not self.editor.stays(task, self.chosen):
            self.form.clear()
            with self.form:
                self.editor = self._new_editor(task)
        self.editor.refresh()

    def _new_editor(self, task: Task) -> ObjectEditor | TrayEditor:
        if self.chosen not in task.kit_names:
            return ObjectEditor(self.edits, self.chosen, self._renamed)
        before = self.editor
        adds_slots = isinstance(before, TrayEditor) and before.name == self.chosen and before.adds_slots
        return TrayEditor(self.edits, self.chosen, self._renamed, adds_slots=adds_slots)

    def _renamed(self, name: str) -> None:
        self.chosen = name

    def _new(self, made: tuple[Task, str]) -> None:
        task, name = made
        before, self.chosen = self.chosen, name
        try:
            self.studio.build(task)
        except BaseException:
            self.chosen = before
            raise

    def _copy(self) -> None:
        task = self.edits.task
        self._new((copy_tray if self.chosen in task.kit_names else copy_object)(task, self.chosen))

    def _remove(self) -> None:
        task = self.edits.task
        self.studio.build((remove_tray if self.chosen in task.kit_names else remove_object)(task, self.chosen))
