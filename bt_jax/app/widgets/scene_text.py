"""The scene for people who do not see it: a list that a screen reader reads on demand, and a line that it reads aloud when a
object has come to stand on something else."""

from __future__ import annotations

from nicegui import ui

from bt_jax.app.state.scene_words import gripper_words, object_words, target_words
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.scene_view import SceneView
from bt_jax.tasks import Task

__all__ = ["SceneText"]


class SceneText:
    """Built into the container that is open, hidden from view."""

    def __init__(self, studio: Studio, page: PageContext, scene: SceneView) -> None:
        self._studio, self._page, self._scene = studio, page, scene
        self._lines: list[str] = []
        self._supports: dict[str, str] = {}
        self._shown: tuple[Task, str] | None = None  # task and step of what was said last
        with ui.element("div").classes("visually-hidden"):
            self._list = ui.element("ul").props('data-testid=scene-list aria-label="What is in the scene"')
            self._news = ui.label().props("role=status data-testid=scene-news")
        page.on("task", self._refresh, now=False)
        page.on("scene", self._refresh, now=False)
        page.on("player", self._refresh, now=False)
        page.on_step(lambda step: self._refresh())

    def _refresh(self) -> None:
        task, world = self._studio.edited.task, self._scene.world
        things = object_words(task, world)
        lines = [*(thing.sentence for thing in things.values()), gripper_words(task, world)]
        if self._scene.shows_targets:
            lines += target_words(task, world)
        if lines == self._lines:
            return
        self._lines = lines
        self._list.clear()
        with self._list:
            for line in lines:
                with ui.element("li"):
                    ui.label(f"{line[:1].upper()}{line[1:]}.")
        supports = {name: thing.support for name, thing in things.items()}
        if self._shown == (task, self._page.step):
            moved = [things[name].sentence for name in supports if supports[name] != self._supports.get(name)]
            if moved:
                self._news.set_text(f"{'; '.join(moved)}.")
        self._supports, self._shown = supports, (task, self._page.step)
