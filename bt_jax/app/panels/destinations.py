"""Buttons that carry what is in the gripper straight over an object, a kit or a slot."""

from __future__ import annotations

import functools

from nicegui import ui

from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.parts import button, known
from bt_jax.app.state.studio import Studio
from bt_jax.tasks import Object, Task
from bt_jax.tasks.slots import fits, slots_by_name

__all__ = ["Destinations"]


class Destinations:
    """A row of what there is, and one of the slots that the held object fits, built into the container that is open."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page = studio, page
        self._guard = functools.partial(page.guard, steers="gripper")
        self._over: dict[str, ui.button] = {}
        self._held: str | None = None
        with ui.row().classes("items-center gap-2"):
            ui.label("Over").classes("teach-word")
            self.over = ui.row().classes("gap-2 items-center teach-destinations")
        with ui.row().classes("items-center gap-2") as self.into:
            ui.label("Slot").classes("teach-word")
            self.slots = (
                ui.row().classes("gap-2 items-center teach-destinations").props("data-testid=demonstrate-slots")
            )
        self.into.set_visibility(False)

    def task_changed(self) -> None:
        """List the objects and kits of the task that is edited now."""
        task = self.studio.edited.task
        self._show_slots(None)
        self.over.clear()
        with self.over:
            self._over = {
                frame: button(
                    known(frame, task, robot="the robot"),
                    f"demonstrate-over-{frame}",
                    "vertical_align_bottom",
                    self._guard(functools.partial(self.studio.teaching.carry_over, frame)),
                    more=f"outline title='Carry straight over {frame}'",
                )
                for frame in (*task.object_names, *task.kit_names)
            }

    def refresh(self, held: str | None) -> None:
        """Offer what the held object can be carried over."""
        for frame, over in self._over.items():
            over.set_enabled(held is not None)
            over.set_visibility(held is None or held != frame)
        if held != self._held:
            self._show_slots(held)

    def _show_slots(self, held: str | None) -> None:
        self._held = held
        task = self.studio.edited.task
        names = [] if held is None else _fitting(task, task.thing(held))
        self.into.set_visibility(bool(names))
        self.slots.clear()
        with self.slots:
            for name in names:
                button(
                    name.partition(".")[2] if len(task.kits) == 1 else name,
                    f"demonstrate-slot-{name}",
                    "vertical_align_bottom",
                    self._guard(functools.partial(self.studio.teaching.carry_to_slot, name)),
                    more=f"outline title='Carry straight over {name}, turned as it lies there'",
                )


def _fitting(task: Task, thing: Object) -> list[str]:
    """Return the names of the slots that an object fits, such as "TrayA.a1"."""
    return [name for name, (kit, slot) in slots_by_name(task.kits).items() if fits(kit, slot, thing)]
