"""Changes of the edited task that a person asks for; those that need the physics take their turn in the worker."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.plain_words import Words
from bt_jax.app.state.arrangement import fixed_layout, put
from bt_jax.app.state.goals import target_keys
from bt_jax.app.state.retargeting import retarget
from bt_jax.app.state.snapping import snapped
from bt_jax.app.state.studio import Studio
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task

__all__ = ["Edits", "Place"]

Point = Float[np.ndarray, "3"]
Place = Callable[[Task, World], Point]  # where an object should be [m, world], computed when its turn comes


class Edits:
    """The edits of one window; each is refused with a UserError if it is impossible."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page = studio, page
        self.guard: Callable[..., Any] = functools.partial(page.guard, steers="task")

    @property
    def task(self) -> Task:
        return self.studio.edited.task

    async def target(self, key: str, place: Place, frame: str | None = None, turn: float | None = None) -> None:
        """Set where something should end, and say so if that is a slot."""
        studio = self.studio
        async with studio.edited.turn:
            task, start = studio.edited.task, studio.edited.start
            changed = await studio.worker.work(
                retarget, task, studio.worker.physics(task), start, key, place(task, start), frame, turn
            )
            self._check_same(task, start)
            studio.edit_task(changed)

    def say_slot(self, key: str) -> None:
        """Say into which slot a target was moved."""
        target = target_keys(self.task).get(key)
        if target is not None and target.slot:
            words = Words(self.task)
            self.page.say(f"{words.named(target.object)} should be {words.target(target)}.", "success")

    async def drop(self, name: str, position: Point) -> None:
        """Let an object start where it was dropped, or in the slot that is close."""
        found = snapped(self.task, self.studio.edited.start, name, position)
        if found is None:
            await self.start(name, lambda task, start: position)
        else:
            await self.start(name, lambda task, start: found.position, turn=found.turn)
            self.page.say(f"{name} starts in {found.slot}.", "success")

    async def start(self, name: str, place: Place, turn: float | None = None) -> None:
        """Set where an object starts."""
        studio = self.studio
        async with studio.edited.turn:
            task, start = studio.edited.task, studio.edited.start
            physics = studio.worker.physics(task)
            world = await studio.worker.work(put, task, physics, start, name, place(task, start), turn)
            self._check_same(task, start)
            self.begin(world)

    def begin(self, world: World) -> None:
        """Start the scene like this, and every episode, too, if the task has a fixed start."""
        self.studio.edit_task(fixed_layout(self.task, world) if self.task.layout.fixed else self.task, world)

    def _check_same(self, task: Task, start: World) -> None:
        if self.studio.edited.task is not task or self.studio.edited.start is not start:
            raise UserError("the task was changed meanwhile; do it again if it is still what you want")
