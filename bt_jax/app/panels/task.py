"""Step 1: what is to be done; choose or build a kit, say where everything should be and where it starts, save it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float
from nicegui import ui

from bt_jax._util.yaml_files import to_yaml
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.kit.beginning import Beginning
from bt_jax.app.panels.kit.edits import Edits
from bt_jax.app.panels.kit.places import Places
from bt_jax.app.panels.kit.start_screen import StartScreen
from bt_jax.app.panels.kit.things import Things
from bt_jax.app.panels.parts import button, may_leave
from bt_jax.app.plain_words import Words, differences, differing_settings
from bt_jax.app.state.kit.complaints import complaints
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.dialogs import ask
from bt_jax.app.widgets.holder_line import holder_line
from bt_jax.app.widgets.scene_view import Dragging
from bt_jax.app.widgets.task_menu import listed_tasks, task_menu
from bt_jax.tasks import Task, task_names

__all__ = ["build"]

Side = Literal["things", "targets", "start"]
DRAGGED: dict[Side, Dragging] = {"things": "things", "targets": "targets", "start": "objects"}
UNSAVED = "Changed, and not saved yet."
HINTS: dict[Side, str] = {
    "things": "Add what there is, and drag {things} and trays in the scene to where they stand.",
    "targets": "Drag {a_thing} in the scene to where it should be, or write it here.",
    "start": "Drag {a_thing} in the scene to where it should start, or write it here.",
}


def build(studio: Studio, page: PanelContext) -> None:
    """Build the start screen and, hidden while that is shown, what there is, the places, and the name to save it under."""
    _Task(studio, page)


class _Task:
    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page, self.edits = studio, page, Edits(studio, page)
        guard = self.edits.guard
        self.said_wrong: tuple[str, ...] = ()
        self.suggested_for = ""  # name of the task for which a name was suggested
        self.start_screen = StartScreen(self.edits, self._leave_start)
        with ui.element("div").classes("task") as self.body:
            self.body.set_visibility(not self.start_screen.element.visible)
            holder_line(studio.holds, page, "task")
            with ui.row().classes("items-center gap-2 w-full no-wrap"):
                more = button("", "task-all", "apps", guard(self._show_start), more="flat round")
                more.props('aria-label="All tasks" title="All tasks, new kit, open a file"')
                self.choice = task_menu(guard(self._choose))
                self.undo = button("", "task-undo", "undo", guard(self._undo), more="flat round data-undo")
                self.undo.props('aria-label="Undo" title="Undo (Ctrl+Z)"')
                self.redo = button("", "task-redo", "redo", guard(self._redo), more="flat round data-redo")
                self.redo.props('aria-label="Redo" title="Redo (Ctrl+Shift+Z)"')
                self.description = ui.label().classes("hint").props("data-testid=task-description")
            with ui.tabs().props("dense no-caps align=left").classes("task-tabs") as self.tabs:
                ui.tab("things", "What there is").props("data-testid=task-things")
                self.ends = ui.tab("targets", "").props("data-testid=task-targets")
                ui.tab("start", "Where they start").props("data-testid=task-start")
            self.hint = ui.label().classes("hint")
            self.things, self.places, self.beginning = Things(self.edits), Places(self.edits), Beginning(self.edits)
            with ui.element("div").props("role=status"):
                self.wrong = ui.element("ul").classes("task-problems")
                self.wrong.props('data-testid=task-problems aria-label="What cannot work yet"')
            ui.separator()
            with ui.row().classes("items-center gap-2 w-full"):
                self.name = (
                    ui.input("Name of your task").props("dense outlined data-testid=task-name").classes("task-name")
                )
                button("Save", "task-save", "save", guard(self._save))
                button("Download", "task-download", "download", self._download, more="outline")
                self.revert = button("Discard changes", "task-revert", "restart_alt", guard(self._revert)).props(
                    "outline"
                )
                self.saved = ui.label().classes("hint task-saved").props("data-testid=task-saved")
        self.tabs.on_value_change(lambda event: self._turn())
        self.tabs.set_value("targets")
        page.on("task", self._refresh)
        page.on("holds", self._refused, now=False)
        page.on_step(lambda step: self._refresh())
        page.scene.on_drop(self._drop)
        page.scene.on_point(self._point)

    @property
    def side(self) -> Side:
        return self.tabs.value

    async def _show_start(self) -> None:
        self.body.set_visibility(False)
        await self.start_screen.show()

    def _leave_start(self) -> None:
        self.start_screen.element.set_visibility(False)
        self.body.set_visibility(True)
        self.tabs.set_value("targets" if self.edits.task.targets else "things")
        self.name.set_value("")
        self._refresh()

    def _refused(self) -> None:
        """Show the task as it is, instead of what was chosen in vain, while another window steers it."""
        if self.studio.holds.other("task", self.page.window) is not None:
            self._refresh()

    def _turn(self) -> None:
        self.page.scene.arrange(DRAGGED[self.side])
        self._refresh()

    def _refresh(self) -> None:
        if self.page.step != "task":
            return
        studio, task, side = self.studio, self.studio.edited.task, self.side
        words = Words(task)
        self.choice.set_options(listed_tasks({*studio.workspace.task_names(), task.name}), value=task.name)
        self.ends.props(f'label="Where {words.things} should be"')
        self.description.set_text(task.description)
        self.hint.set_text(HINTS[side].format(things=words.things, a_thing=words.a_thing))
        self.things.element.set_visibility(side == "things")
        self.places.element.set_visibility(side != "things")
        self.beginning.element.set_visibility(side == "start")
        if side == "things":
            self.things.refresh()
        else:
            self.places.refresh(side)
            self.beginning.refresh()
        if not self.name.value or self.suggested_for != task.name:
            self.suggested_for = task.name
            self.name.set_value(task.name if task.name not in task_names() else f"my_{task.name}")
        self.saved.set_text(self._state())
        self.revert.set_visibility(not studio.edited.saved and task.name in studio.workspace.task_names())
        self.undo.set_enabled(studio.edited.can_undo)
        self.redo.set_enabled(studio.edited.can_redo)
        self._say_wrong(complaints(task))

    def _say_wrong(self, sentences: tuple[str, ...]) -> None:
        """List what cannot work yet; it is read aloud once."""
        if sentences == self.said_wrong:
            return
        self.said_wrong = sentences
        self.wrong.clear()
        with self.wrong:
            for sentence in sentences:
                with ui.element("li"):
                    ui.label(sentence)

    def _state(self) -> str:
        """Say whether the changes are saved."""
        studio, name = self.studio, self.studio.edited.task.name
        if studio.edited.saved:
            return "" if name in task_names() else f"Saved as tasks/{name}.yaml"
        return UNSAVED if studio.unsaved else f"The task of the run {studio.playing.run}; not saved as a task."

    async def _drop(self, dragged: Dragging, name: str, position: Float[np.ndarray, "3"]) -> None:
        if self.page.step != "task":
            return
        self.page.steer("task")
        if dragged == "things":
            await self.things.drop(name, position)
        elif dragged == "targets":
            await self.places.drop(name, position)
        else:
            await self.edits.drop(name, position)

    def _point(self, name: str, position: Float[np.ndarray, "3"]) -> None:
        if self.page.step == "task" and self.side == "things":
            self.page.steer("task")
            self.things.point(name, position)

    async def _choose(self) -> None:
        name = self.choice.value
        if await may_leave(self.studio):
            self._open(name)
        else:
            self._refresh()

    def _revert(self) -> None:
        try:
            self.studio.revert_task()
        finally:
            self._refresh()

    def _open(self, name: str) -> None:
        """Open a task as its file says; if that fails, show the present one in the choice again."""
        try:
            self.studio.open_task(self.studio.workspace.task(name))
            self.name.set_value("")
        finally:
            self._refresh()

    async def _save(self) -> None:
        name, workspace = self.name.value.strip(), self.studio.workspace
        if name == self.studio.edited.task.name and name not in task_names():
            question = f"The file of {name} was changed meanwhile." if self.studio.edited.changed_on_disk else ""
        else:
            question = f"There is a task {name} already." if workspace.filed(name) is not None else ""
        if question and not await ask(question, yes="Replace it", testid="task-replace"):
            return
        self.studio.save_task(name)
        self.page.say(f"The task is saved as {name}.", "success")

    def _download(self) -> None:
        task = self.studio.edited.task
        ui.download.content(to_yaml(task.to_dict()), f"{task.name}.yaml")

    def _undo(self) -> None:
        after = self.studio.edited.task
        self.studio.undo_edit()
        self._say_changed("Taken back", after)

    def _redo(self) -> None:
        before = self.studio.edited.task
        self.studio.redo_edit()
        self._say_changed("Done again", before)

    def _say_changed(self, what: str, before: Task) -> None:
        """Say what was undone or redone: it may be an edit of another window."""
        now = self.studio.edited.task
        said = [*differences(now, before), *(f"other {one}" for one in differing_settings(now, before))] or [
            f"the name is {now.name}" if now.name != before.name else "the start is another"
        ]
        self.page.say(f"{what}: now {'; '.join(said)}.", "success")
