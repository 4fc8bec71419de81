"""Where objects should be and where they start: one row for each, with numbers, and goals as sentences."""

from __future__ import annotations

import functools
from typing import Literal

import numpy as np
from jaxtyping import Float
from nicegui import ui

from bt_jax.app.panels.kit.edits import Edits
from bt_jax.app.panels.kit.sentence import Sentence
from bt_jax.app.panels.parts import button, css_color
from bt_jax.app.plain_words import Words
from bt_jax.app.state.goals import key_of, kind_of, new_key, target_keys
from bt_jax.app.state.retargeting import spare_place, untarget
from bt_jax.app.state.spots import Spot, origins, references, spot_at, spot_of_target
from bt_jax.app.widgets.place_fields import PlaceFields
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Object, Task

__all__ = ["Places", "PlacesSide"]

PlacesSide = Literal["targets", "start"]
IN_FULL = 4  # targets that are shown with their numbers; of more, the numbers are folded


class Places:
    """Built into the container that is open."""

    def __init__(self, edits: Edits) -> None:
        self.edits, self.studio, self.page = edits, edits.studio, edits.page
        self.shape: tuple[object, ...] = ()
        self.fields: dict[str, PlaceFields] = {}
        self.words: dict[str, ui.label] = {}
        with ui.element("div").classes("task-places") as self.element:
            self.sentence = Sentence(edits)
            self.rows = ui.element("div").classes("task-rows")

    def refresh(self, side: PlacesSide) -> None:
        """Show the targets or the start as they are; rows stay as long as there are the same, and the focus with them."""
        task, start = self.edits.task, self.studio.edited.start
        self.sentence.show(side == "targets")
        targets = target_keys(task)
        shape = (side, task.objects, task.kits, tuple(targets))
        if shape != self.shape:
            self.shape = shape
            self._build_rows(side)
        for key, fields in self.fields.items():
            if side == "start":
                fields.show(spot_at(task, start, key))
            else:
                fields.show(spot_of_target(task, start, key))
                self.words[key].set_text(Words(task).target(targets[key]))

    async def drop(self, name: str, position: Float[np.ndarray, "3"]) -> None:
        """Set a target by its key, or by the object that was dragged."""
        task = self.edits.task
        key = key_of(task, self.studio.edited.start, name)
        target = target_keys(task).get(key)
        await self.edits.target(key, lambda task, start: position, turn=None if target is None else target.turn)
        self.edits.say_slot(key)

    def _build_rows(self, side: PlacesSide) -> None:
        self.fields, self.words = {}, {}
        task = self.edits.task
        self.rows.clear()
        with self.rows:
            if side == "start":
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
        task = self.edits.task
        with self._row(thing.name), ui.row().classes("items-center gap-2 no-wrap"):
            _name(thing, thing.name)
            tables = [table.name for table in task.tables]
            self._fields("start", thing, thing.name, tables, spot_at(task, self.studio.edited.start, thing.name))

    def _target_row(self, kind: str, key: str) -> None:
        task, thing = self.edits.task, self.edits.task.thing(kind)
        with self._row(key):
            with ui.row().classes("items-center gap-2 no-wrap") as title:
                _name(thing, kind)
                self.words[key] = ui.label().classes("task-words").props(f"data-testid=task-words-{key}")
                hint = f"{kind} may be anywhere" if thing.name == kind else f"No {kind} has to be there"
                remove = self.edits.guard(lambda: self.studio.edit_task(untarget(self.edits.task, key)))
                with ui.button(icon="close", on_click=remove).props(
                    f'flat dense size=sm data-testid=task-remove-{key} aria-label="{hint}"'
                ):
                    ui.tooltip(hint)
            with ui.row().classes("items-center gap-2 no-wrap task-numbers") as numbers:
                spot = spot_of_target(task, self.studio.edited.start, key)
                self._fields("targets", thing, key, references(task, kind), spot)
            if len(task.targets) > IN_FULL:
                _fold(title, numbers, key)

    def _spare_row(self, kind: str, key: str) -> None:
        """Offer a target for an object, or an instance, that may be anywhere."""
        task = self.edits.task
        spare = len(task.instances[kind]) - sum(target.object == kind for target in task.targets)
        said = "may be anywhere" if kind == key else f"{spare} may be anywhere"
        with self._row(key), ui.row().classes("items-center gap-2 no-wrap"):
            _name(task.thing(kind), kind)
            ui.label(said).classes("task-words").props(f"data-testid=task-words-{key}")
            button("Add a target", f"task-add-{key}", "add", self.edits.guard(lambda: self._add(kind)))

    def _row(self, key: str) -> ui.element:
        return ui.element("div").classes("task-row").props(f"data-testid=task-row-{key}")

    def _fields(self, side: PlacesSide, thing: Object, key: str, measured_from: list[str], spot: Spot) -> None:
        self.fields[key] = PlaceFields(
            self.page,
            key,
            measured_from,
            spot,
            functools.partial(self._place, side, key),
            turns=bool(thing.symmetry) and (not thing.is_cube or (side == "targets" and spot.turn is not None)),
            any_turn=side == "targets",
        )

    async def _place(self, side: PlacesSide, key: str, spot: Spot) -> None:
        self.page.steer("task")

        def place(task: Task, start: World) -> Float[np.ndarray, "3"]:
            return spot.point(task, kind_of(key), origins(task, start, ended=side == "targets"))

        if side == "targets":
            await self.edits.target(key, place, spot.frame(self.edits.task), turn=spot.turn)
        else:
            await self.edits.start(key, place, turn=spot.turn)

    async def _add(self, kind: str) -> None:
        """Add a target where the object, or an instance without one, is now."""
        await self.edits.target(new_key(self.edits.task, kind), lambda task, start: spare_place(task, start, kind))


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
