"""The fields of an object, or of a part: name, shape, size, number, colour, and how it lies."""

from __future__ import annotations

import functools
from collections.abc import Callable

from nicegui import ui

from bt_jax.app.panels.kit.edits import Edits
from bt_jax.app.panels.kit.form import Form
from bt_jax.app.panels.parts import button, mark
from bt_jax.app.state.extents import heading, poses_now
from bt_jax.app.state.kit.objects import COLORS, count_object, rename_object, shape_object
from bt_jax.app.units import in_metres, in_millimetres
from bt_jax.tasks import Object, Task

__all__ = ["ObjectEditor"]

LENGTHS = {"cuboid": ("long", "deep", "high"), "cylinder": ("across", "", "high")}
COLOR_NAMES = ("yellow", "green", "blue", "red", "orange", "purple", "turquoise", "grey")
TURN = 15.0  # degrees, by which a press of the button turns


class ObjectEditor:
    """Built into the container that is open; `renamed` is told the new name before the task has it."""

    def __init__(self, edits: Edits, kind: str, renamed: Callable[[str], None]) -> None:
        self.edits, self.kind, self._renamed = edits, kind, renamed
        self.shape, self.form = self.thing.shape, Form(edits)
        with ui.row().classes("items-center gap-2"):
            self.form.text("Name", "kit-name", lambda: self.kind, self._rename)
            self.form.number(
                "how many",
                "kit-count",
                lambda: len(edits.task.instances[self.kind]),
                lambda value: edits.studio.build(count_object(edits.task, self.kind, int(value))),
                called="How many there are, all alike",
                whole=True,
            )
            self.form.choice(
                "Shape",
                "kit-shape",
                {"cuboid": "Box", "cylinder": "Can"},
                lambda: self.thing.shape,
                lambda shape: edits.studio.build(shape_object(edits.task, self.kind, shape=shape)),
            )
        with ui.row().classes("items-center gap-2"):
            for axis, label in enumerate(LENGTHS[self.shape]):
                if label:
                    self._length(axis, label)
            if self.thing.symmetry:
                button(f"Turn by {TURN:g}°", "kit-turn", "rotate_left", edits.guard(self._turn), more="outline")
        with ui.row().classes("gap-1").props('role=group aria-label="Colour"'):
            for name, color in zip(COLOR_NAMES, COLORS, strict=True):
                swatch = (
                    ui.element("button")
                    .classes("kit-swatch")
                    .on("click", edits.guard(functools.partial(self._paint, color)), [])
                )
                swatch.style("background: rgb({} {} {})".format(*(round(255 * part) for part in color)))
                mark(swatch, f"kit-color-{name}", aria_label=name, title=name, type="button")

    @property
    def thing(self) -> Object:
        return self.edits.task.thing(self.kind)

    def stays(self, task: Task, chosen: str) -> bool:
        """Return whether these are the fields of what is chosen."""
        return chosen == self.kind and chosen in task.instances and task.thing(chosen).shape == self.shape

    def refresh(self) -> None:
        """Show the values as they are."""
        self.form.refresh()

    def _length(self, axis: int, label: str) -> None:
        def change(value: float) -> None:
            x, y, z = (in_metres(value) if i == axis else edge for i, edge in enumerate(self.thing.size))
            self.edits.studio.build(shape_object(self.edits.task, self.kind, size=(x, y, z)))

        self.form.number(f"{label}, mm", f"kit-size-{label}", lambda: in_millimetres(self.thing.size[axis]), change)

    def _rename(self, name: str) -> None:
        task = rename_object(self.edits.task, self.kind, name.strip())
        before, self.kind = self.kind, name.strip()
        self._renamed(self.kind)
        try:
            self.edits.studio.build(task)
        except BaseException:
            self.kind = before
            self._renamed(before)
            raise

    def _paint(self, color: tuple[float, float, float]) -> None:
        self.edits.studio.build(shape_object(self.edits.task, self.kind, color=color))

    async def _turn(self) -> None:
        """Turn the object, or the first of its part, where it stands at the start."""
        pose = poses_now(self.edits.task, self.edits.studio.edited.start)[self.thing.name]
        await self.edits.start(self.thing.name, lambda task, start: pose[:3], turn=heading(pose) + TURN)
