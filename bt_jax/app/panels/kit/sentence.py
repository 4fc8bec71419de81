"""A goal as a sentence that a person writes, with what it may become."""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Float
from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.kit.edits import Edits
from bt_jax.app.panels.parts import button
from bt_jax.app.spoken_goals import completions, goal_sentence, read_goal
from bt_jax.app.state.extents import in_world
from bt_jax.app.state.goals import goals, new_key
from bt_jax.mjx_env.world import World, frames
from bt_jax.tasks import Target, Task

__all__ = ["Sentence"]


class Sentence:
    """Built into the container that is open."""

    def __init__(self, edits: Edits) -> None:
        self.edits, self.studio = edits, edits.studio
        with ui.element("div").classes("task-sentence") as self.element:
            with ui.row().classes("items-center gap-2 no-wrap"):
                self.field = ui.input("Or say it: what should be where", on_change=self._complete)
                self.field.props("dense outlined clearable debounce=150 autocomplete=off data-testid=task-sentence")
                self.field.classes("flex-1").on("keydown.enter", edits.guard(self._say))
                button("Set", "task-say", "check", edits.guard(self._say))
            self.offered = ui.row().classes("gap-1 task-offered").props('role=group aria-label="It may become"')
        self.shown: list[str] = []

    def show(self, visible: bool) -> None:
        """Show the field, or hide it."""
        self.element.set_visibility(visible)

    def _complete(self) -> None:
        text = self.field.value or ""
        found = completions(self.edits.task, text) if text else []
        if found != self.shown:
            self.shown = found
            self.offered.clear()
            with self.offered:
                for i, sentence in enumerate(found):
                    take = self.edits.guard(functools.partial(self._say, sentence))
                    ui.button(sentence, on_click=take).props(f"no-caps flat dense data-testid=task-offer-{i}")

    async def _say(self, sentence: str | None = None) -> None:
        task = self.edits.task
        target = read_goal(task, self.field.value or "" if sentence is None else sentence)
        key = _key(task, target)

        def place(task: Task, start: World) -> Float[np.ndarray, "3"]:
            ended = {goal.thing: goal.pose for goal in goals(task, start).values()}
            now = np.asarray(frames(start, task)[0, task.frames.index(target.frame)], float)
            return in_world(ended.get(target.frame, now), np.array(target.position))

        await self.edits.target(key, place, target.frame, target.turn)
        self.field.set_value("")
        self.edits.page.say(f"{goal_sentence(self.edits.task, _of(self.edits.task, key, target))}.", "success")


def _key(task: Task, target: Target) -> str:
    """Return the key of the target that a sentence sets: that of its object, or of one more of its part."""
    key = new_key(task, target.object)
    if key != target.object and sum(one.object == target.object for one in task.targets) >= len(
        task.instances[target.object]
    ):
        raise UserError(f"every {target.object} has a target already; remove or move one of those")
    return key


def _of(task: Task, key: str, target: Target) -> Target:
    """Return a target as it was set, which may be in a slot that was close."""
    same = [one for one in task.targets if one.object == target.object]
    return same[-1] if same else target
