"""Step 1: what is to be done; choose a task, set where objects should end and where they start, save it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Float
from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.parts import button, css_color, may_leave
from bt_jax.app.plain_words import Words, differences, differing_settings
from bt_jax.app.state.arrangement import fixed_layout, free_layout, kit_table, kit_tables, move_kit, put
from bt_jax.app.state.goals import key_of, kind_of, new_key, target_keys
from bt_jax.app.state.retargeting import retarget, spare_place, untarget
from bt_jax.app.state.snapping import snapped
from bt_jax.app.state.spots import Spot, origins, references, spot_at, spot_of_target
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.dialogs import ask
from bt_jax.app.widgets.holder_line import holder_line
from bt_jax.app.widgets.place_fields import PlaceFields
from bt_jax.app.widgets.task_menu import listed_tasks, task_menu
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Object, Task, load_task, task_names

__all__ = ["build"]

Side = Literal["targets", "start"]
Place = Callable[
    [Task, World], Float[np.ndarray, "3"]
]  # where an object should be [m, world], computed when its turn comes
CHOSEN = "update:model-value"  # sent for choices of a person only, not for changes by the program
IN_FULL = 4  # targets that are shown with their numbers; of more, the numbers are folded
UNSAVED = "Changed, and not saved yet."
HINTS = {
    "targets": "Drag a dashed {thing} in the scene to where the {thing} should be, or write it here.",
    "start": "Drag {a_thing} in the scene to where it should start, or write it here.",
}


def build(studio: Studio, page: PanelContext) -> None:
    """Build the choice of a task, the places, and the name to save it under."""
    _Task(studio, page)


class _Task:
    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page = studio, page
        self._guard = guard = functools.partial(page.guard, steers="task")
        self.draws = 0
        self.suggested_for = ""  # name of the task for which a name was suggested
        self.shape: tuple[object, ...] = ()
        self.fields: dict[str, PlaceFields] = {}
        self.words: dict[str, ui.label] = {}
        with ui.element("div").classes("task"):
            holder_line(studio.holds, page, "task")
            with ui.row().classes("items-center gap-2 w-full no-wrap"):
                self.choice = task_menu(guard(self._choose))
                self.undo = button("", "task-undo", "undo", guard(self._undo), more="flat round data-undo")
                self.undo.props('aria-label="Undo" title="Undo (Ctrl+Z)"')
                self.redo = button("", "task-redo", "redo", guard(self._redo), more="flat round data-redo")
                self.redo.props('aria-label="Redo" title="Redo (Ctrl+Shift+Z)"')
                self.description = ui.label().classes("hint").props("data-testid=task-description")
            with ui.tabs().props("dense no-caps align=left").classes("task-tabs") as self.tabs:
                self.ends = ui.tab("targets", "").props("data-testid=task-targets")
                ui.tab("start", "Where they start").props("data-testid=task-start")
            self.hint = ui.label().classes("hint")
            with ui.element("div").classes("task-rows") as self.rows:
                pass
            with ui.element("div").classes("task-beginning") as self.beginning:
                with ui.row().classes("items-center gap-2"):
                    self.kit = (
                        ui.select([], label="The kit stands on")
                        .on(CHOSEN, guard(self._move_kit))
                        .props("dense outlined options-dense data-testid=task-kit")
                        .classes("task-reference")
                    )
                    button("Another random start", "task-random", "shuffle", guard(self._random))
                self.fixed = (
                    ui.radio({False: "It starts elsewhere every time", True: "It always starts as shown now"})
                    .on(CHOSEN, guard(self._fix))
                    .props("dense data-testid=task-fixed")
                )
            ui.separator()
            with ui.row().classes("items-center gap-2 w-full"):
                self.name = (
                    ui.input("Name of your task").props("dense outlined data-testid=task-name").classes("task-name")
                )
                button("Save", "task-save", "save", guard(self._save))
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

    @property
    def side(self) -> Side:
        return self.tabs.value

    def _refused(self) -> None:
        """Show the task as it is, instead of what was chosen in vain, while another window steers it."""
        if self.studio.holds.other("task", self.page.window) is not None:
            self._refresh()

    def _turn(self) -> None:
        self.page.scene.arrange("targets" if self.side == "targets" else "objects")
        self._refresh()

    def _refresh(self) -> None:
        if self.page.step != "task":
            return
        studio, task = self.studio, self.studio.edited.task
        self.choice.set_options(listed_tasks({*studio.workspace.task_names(), task.name}), value=task.name)
        words, tables = Words(task), kit_tables(task)
        self.kit.set_visibility(bool(tables))
        if tables:
            self.kit.set_options(tables, value=kit_table(task, studio.edited.start))
        self.kit.props(f'label="The kit{"s stand" if len(task.kits) > 1 else " stands"} on"')
        self.ends.props(f'label="Where {words.things} should be"')
        self.fixed.set_value(bool(task.layout.fixed))
        self.description.set_text(task.description)
        self.beginning.set_visibility(self.side == "start")
        self.hint.set_text(HINTS[self.side].format(thing=words.thing, a_thing=words.a_thing))
        if not self.name.value or self.suggested_for != task.name:
            self.suggested_for = task.name
            self.name.set_value(task.name if task.name not in task_names() else f"my_{task.name}")
        self.saved.set_text(self._state())
        self.revert.set_visibility(not studio.edited.saved)
        self.undo.set_enabled(studio.edited.can_undo)
        self.redo.set_enabled(studio.edited.can_redo)
        targets = target_keys(task)
        shape = (self.side, task.objects, task.kits, tuple(targets))
        if shape != self.shape:
            self.shape = shape
            self._build_rows()
        for key, fields in self.fields.items():
            if self.side == "start":
                fields.show(spot_at(task, studio.edited.start, key))
            else:
                fields.show(spot_of_target(task, studio.edited.start, key))
                self.words[key].set_text(words.target(targets[key]))

    def _state(self) -> str:
        """Say whether the changes are saved."""
        studio, name = self.studio, self.studio.edited.task.name
        if studio.edited.saved:
            return "" if name in task_names() else f"Saved as tasks/{name}.yaml"
        return UNSAVED if studio.unsaved else f"The task of the run {studio.playing.run}; not saved as a task."

    def _build_rows(self) -> None:
        """Build one row for each object or target; rows stay as long as their shape does, so that the focus stays, too."""
        self.fields, self.words = {}, {}
        task = self.studio.edited.task
        self.rows.clear()
        with self.rows:
            if self.side == "start":
                for thing in task.objects:
                    self._start_row(thing)
                return
            keys = target_keys(task)
            for kind in dict.fromkeys([*task.kinds, *map(kind_of, keys)]):
                own = [key for key in keys if kind_of(key) == kind]
                for key in own:
                    self._target_row(kind, key)
                if len(own) < len(task.instances[kind]):
                    self._spare_row(kind, new_key(task, kind))

    def _start_row(self, thing: Object) -> None:
        task = self.studio.edited.task
        with self._row(thing.name), ui.row().classes("items-center gap-2 no-wrap"):
            _name(thing, thing.name)
            tables = [table.name for table in task.tables]
            self._fields(thing, thing.name, tables, spot_at(task, self.studio.edited.start, thing.name))

    def _target_row(self, kind: str, key: str) -> None:
        task, thing = self.studio.edited.task, self.studio.edited.task.thing(kind)
        with self._row(key):
            with ui.row().classes("items-center gap-2 no-wrap") as title:
                _name(thing, kind)
                self.words[key] = ui.label().classes("task-words").props(f"data-testid=task-words-{key}")
                hint = f"{kind} may be anywhere" if thing.name == kind else f"No {kind} has to be there"
                remove = self._guard(lambda: self._edit(untarget(self.studio.edited.task, key)))
                with ui.button(icon="close", on_click=remove).props(
                    f'flat dense size=sm data-testid=task-remove-{key} aria-label="{hint}"'
                ):
                    ui.tooltip(hint)
            with ui.row().classes("items-center gap-2 no-wrap task-numbers") as numbers:
                self._fields(thing, key, references(task, kind), spot_of_target(task, self.studio.edited.start, key))
            if len(task.targets) > IN_FULL:
                _fold(title, numbers, key)

    def _spare_row(self, kind: str, key: str) -> None:
        """Offer a target for an object, or an instance, that may be anywhere."""
        task = self.studio.edited.task
        spare = len(task.instances[kind]) - sum(target.object == kind for target in task.targets)
        said = "may be anywhere" if kind == key else f"{spare} may be anywhere"
        with self._row(key), ui.row().classes("items-center gap-2 no-wrap"):
            _name(task.thing(kind), kind)
            ui.label(said).classes("task-words").props(f"data-testid=task-words-{key}")
            button("Add a target", f"task-add-{key}", "add", self._guard(lambda: self._add(kind)))

    def _row(self, key: str) -> ui.element:
        return ui.element("div").classes("task-row").props(f"data-testid=task-row-{key}")

    def _fields(self, thing: Object, key: str, measured_from: list[str], spot: Spot) -> None:
        self.fields[key] = PlaceFields(
            self.page,
            key,
            measured_from,
            spot,
            functools.partial(self._place, self.side, key),
            turns=bool(thing.symmetry) and (not thing.is_cube or (self.side == "targets" and spot.turn is not None)),
            any_turn=self.side == "targets",
        )

    async def _place(self, side: Side, key: str, spot: Spot) -> None:
        self.page.steer("task")

        def place(task: Task, start: World) -> Float[np.ndarray, "3"]:
            return spot.point(task, kind_of(key), origins(task, start, ended=side == "targets"))

        if side == "targets":
            await self._target(key, place, spot.frame(self.studio.edited.task), turn=spot.turn)
        else:
            await self._start(key, place, turn=spot.turn)

    async def _add(self, kind: str) -> None:
        """Add a target where the object, or an instance without one, is now."""
        await self._target(new_key(self.studio.edited.task, kind), lambda task, start: spare_place(task, start, kind))

    async def _drop(self, dragged: str, name: str, position: Float[np.ndarray, "3"]) -> None:
        if self.page.step != "task":
            return
        self.page.steer("task")
        if dragged == "targets":
            task, start = self.studio.edited.task, self.studio.edited.start
            key = key_of(task, start, name)
            target = target_keys(task).get(key)
            await self._target(key, lambda task, start: position, turn=None if target is None else target.turn)
            self._say_slot(key)
        else:
            await self._drop_start(name, position)

    def _say_slot(self, key: str) -> None:
        """Say into which slot a target was moved."""
        task = self.studio.edited.task
        target = target_keys(task).get(key)
        if target is not None and target.slot:
            words = Words(task)
            self.page.say(f"{words.named(target.object)} should be {words.target(target)}.", "success")

    async def _drop_start(self, name: str, position: Float[np.ndarray, "3"]) -> None:
        found = snapped(self.studio.edited.task, self.studio.edited.start, name, position)
        if found is None:
            await self._start(name, lambda task, start: position)
        else:
            await self._start(name, lambda task, start: found.position, turn=found.turn)
            self.page.say(f"{name} starts in {found.slot}.", "success")

    async def _target(self, key: str, place: Place, frame: str | None = None, turn: float | None = None) -> None:
        studio = self.studio
        async with studio.edited.turn:
            task, start = studio.edited.task, studio.edited.start
            changed = await studio.worker.work(
                retarget, task, studio.worker.physics(task), start, key, place(task, start), frame, turn
            )
            self._check_same(task, start)
            self._edit(changed)

    async def _start(self, name: str, place: Place, turn: float | None = None) -> None:
        studio = self.studio
        async with studio.edited.turn:
            task, start = studio.edited.task, studio.edited.start
            physics = studio.worker.physics(task)
            world = await studio.worker.work(put, task, physics, start, name, place(task, start), turn)
            self._check_same(task, start)
            self._begin(world)

    def _check_same(self, task: Task, start: World) -> None:
        if self.studio.edited.task is not task or self.studio.edited.start is not start:
            raise UserError("the task was changed meanwhile; do it again if it is still what you want")

    def _begin(self, world: World) -> None:
        """Start the scene like this, and every episode, too, if the task has a fixed start."""
        task = self.studio.edited.task
        self._edit(fixed_layout(task, world) if task.layout.fixed else task, world)

    def _edit(self, task: Task, start: World | None = None) -> None:
        self.studio.edit_task(task, start)

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
            self.draws = 0
            self.name.set_value("")
        finally:
            self._refresh()

    def _random(self) -> None:
        studio = self.studio
        self.draws += 1
        free = free_layout(studio.edited.task, self._base())
        world = sample_layouts(free, [7, self.draws], 1)
        studio.edit_task(fixed_layout(free, world) if studio.edited.task.layout.fixed else free, world)

    def _base(self) -> Task:
        """Return the task whose layouts are drawn if nothing is fixed."""
        task = self.studio.edited.task
        return load_task(task.name) if task.layout.fixed and task.name in task_names() else task

    def _move_kit(self) -> None:
        try:
            self._begin(move_kit(self.studio.edited.task, self.studio.edited.start, self.kit.value))
        finally:
            self._refresh()

    def _fix(self) -> None:
        task, start = self.studio.edited.task, self.studio.edited.start
        try:
            self.studio.edit_task(
                fixed_layout(task, start) if self.fixed.value else free_layout(task, self._base()), start
            )
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


def _name(thing: Object, name: str) -> None:
    ui.element("span").classes("task-chip").style(f"background: {css_color(thing)}")
    ui.label(name).classes("task-box")


def _fold(title: ui.element, numbers: ui.element, key: str) -> None:
    """Hide the numbers of a row until a person asks for them."""

    def turn() -> None:
        numbers.set_visibility(not numbers.visible)
        unfold.props(f"aria-expanded={str(numbers.visible).lower()}")

    numbers.set_visibility(False)
    with title:
        unfold = button("", f"task-unfold-{key}", "tune", turn, more="flat size=sm aria-expanded=false")
        unfold.props(f'aria-label="{key}, in numbers" title="In numbers"')
        unfold.move(target_index=2)
