"""The banner over every step: where the tasks of step 1 and of the evolution differ, it says so and asks which counts."""

from __future__ import annotations

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.parts import button, may_leave
from bt_jax.app.plain_words import differences, differing_settings
from bt_jax.app.processes.train_command import NO_CHANGES
from bt_jax.app.state.edited_task import same_places, same_things
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext
from bt_jax.tasks import Task
from bt_jax.training.phases import Changes

__all__ = ["GoalBanner"]

MORE = 50  # generations for the new targets, as step 2 suggests


class GoalBanner:
    """Built into the container that is open."""

    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page = studio, page
        with ui.element("div").classes("notices"), ui.element("div").classes("notice") as self._area:
            ui.icon("call_split").props("aria-hidden=true")
            self._text = ui.label().classes("notice-text").props("data-testid=banner-text role=status")
            self._old = button(
                "Back to the old targets", "banner-old", "undo", page.guard(self._back, steers="task"), more="flat"
            )
            self._new = button(
                "Evolve for the new ones", "banner-new", "fast_forward", page.guard(self._evolve), more="flat"
            )
            button("Keep both", "banner-both", "close", page.guard(studio.keep_both), more="flat")
        self._area.props("data-testid=banner")
        for topic in ("task", "evolution", "notices"):
            page.on(topic, self._refresh)

    def _refresh(self) -> None:
        studio = self.studio
        self._area.set_visibility(studio.asks_for_goal)
        task, evolution = studio.evolution.task, studio.evolution
        if task is None or not studio.asks_for_goal:
            return
        same = same_things(task, studio.edited.task)
        if same:
            said = _said(evolution.run, task, studio.edited.task)
        else:
            said = (
                f"The evolution {evolution.run} works for other objects; for those here, press “Find a tree” in step 2."
            )
        self._text.set_text(said)
        only_places = same and not differing_settings(task, studio.edited.task)
        self._old.set_text("Back to the old targets" if only_places else "Back to the old task")
        places = same and not same_places(task, studio.edited.task)
        self._new.set_visibility(places and evolution.progress is not None)
        self._new.set_enabled(not evolution.running)
        self._new.props(f'title="{"Stop the evolution in step 2 first" if evolution.running else ""}"')

    async def _back(self) -> None:
        studio, task = self.studio, self.studio.evolution.task
        if task is None:
            raise UserError("the evolution has gone; choose a task in step 1")
        if same_things(task, studio.edited.task):
            studio.take_goal(task)
        elif await may_leave(studio):
            studio.open_task(task)

    def _evolve(self) -> None:
        studio = self.studio
        task = studio.edited.task
        changes = NO_CHANGES if studio.in_step else Changes(task=task)
        studio.go_on(MORE, changes)
        self.page.go("evolve")


def _said(run: str | None, theirs: Task, ours: Task) -> str:
    """Say in what the task of an evolution and that of step 1 differ; they have the same objects."""
    said, settings = [], ", ".join(differing_settings(ours, theirs))
    if not same_places(theirs, ours):
        said += [
            f"The evolution {run} works for: {'; '.join(differences(theirs, ours))}.",
            f"Step 1 says: {'; '.join(differences(ours, theirs))}.",
        ]
    if settings:
        said += [
            f"Step 1 {'also ' if said else ''}has other settings than the evolution{'' if said else f' {run}'}: {settings}.",
            "To evolve with them, press “Find a tree” in step 2.",
        ]
    return " ".join(said)
