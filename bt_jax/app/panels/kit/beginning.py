"""How every try begins: the table of the kit, at random or always the same."""

from __future__ import annotations

from nicegui import ui

from bt_jax.app.panels.kit.edits import Edits
from bt_jax.app.panels.parts import button
from bt_jax.app.state.arrangement import fixed_layout, free_layout, kit_table, kit_tables, move_kit
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import Task, load_task, task_names

__all__ = ["Beginning"]

CHOSEN = "update:model-value"  # sent for choices of a person only, not for changes by the program


class Beginning:
    """Built into the container that is open."""

    def __init__(self, edits: Edits) -> None:
        self.edits, self.studio = edits, edits.studio
        self.draws = 0
        with ui.element("div").classes("task-beginning") as self.element:
            with ui.row().classes("items-center gap-2"):
                self.kit = (
                    ui.select([], label="The kit stands on")
                    .on(CHOSEN, edits.guard(self._move_kit))
                    .props("dense outlined options-dense data-testid=task-kit")
                    .classes("task-reference")
                )
                button("Another random start", "task-random", "shuffle", edits.guard(self._random))
            self.fixed = (
                ui.radio({False: "It starts elsewhere every time", True: "It always starts as shown now"})
                .on(CHOSEN, edits.guard(self._fix))
                .props("dense data-testid=task-fixed")
            )

    def refresh(self) -> None:
        """Show the start as it is."""
        task = self.edits.task
        tables = kit_tables(task)
        self.kit.set_visibility(bool(tables))
        if tables:
            self.kit.set_options(tables, value=kit_table(task, self.studio.edited.start))
        self.kit.props(f'label="The kit{"s stand" if len(task.kits) > 1 else " stands"} on"')
        self.fixed.set_value(bool(task.layout.fixed))

    def _random(self) -> None:
        studio = self.studio
        self.draws += 1
        free = free_layout(studio.edited.task, self._base())
        world = sample_layouts(free, [7, self.draws], 1)
        studio.edit_task(fixed_layout(free, world) if studio.edited.task.layout.fixed else free, world)

    def _base(self) -> Task:
        """Return the task whose layouts are drawn if nothing is fixed."""
        task = self.edits.task
        return load_task(task.name) if task.layout.fixed and task.name in task_names() else task

    def _move_kit(self) -> None:
        try:
            self.edits.begin(move_kit(self.edits.task, self.studio.edited.start, self.kit.value))
        finally:
            self.refresh()

    def _fix(self) -> None:
        task, start = self.edits.task, self.studio.edited.start
        try:
            self.studio.edit_task(
                fixed_layout(task, start) if self.fixed.value else free_layout(task, self._base()), start
            )
        finally:
            self.refresh()
