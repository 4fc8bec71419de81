"""The question for which task an evolution goes on: its own, or the one that step 1 shows by now."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.parts import heading
from bt_jax.app.plain_words import Words, differing_settings
from bt_jax.app.processes.train_command import NO_CHANGES
from bt_jax.app.state.edited_task import same_places, same_things
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.dialogs import dialog
from bt_jax.tasks import Task
from bt_jax.training.phases import Changes

__all__ = ["ask_goal"]


async def ask_goal(studio: Studio, changes: Changes = NO_CHANGES) -> Changes | None:
    """Return the changes, with the task of step 1 as it is shown here if a person wants the evolution to go on for it; None
    if they cancel. It is asked only if the two tasks differ. Raise UserError if another run is opened meanwhile."""
    run, evolved, edited = studio.evolution.run, studio.evolution.task, studio.edited.task
    if evolved is None or studio.in_step:
        return changes
    with dialog("Which task to go on with") as asked:
        ui.label("The task in step 1 is not the one that this evolution works for.").classes("text-bold")
        with ui.row().classes("gap-6 no-wrap").props("data-testid=goal-differences"):
            _column("The evolution works for", _sentences(evolved))
            _column("Step 1 says", _sentences(edited))
        if not same_things(evolved, edited):
            ui.label("The objects differ: to evolve for the task in step 1, press “Find a tree” in step 2.")
        else:
            if evolved.layout != edited.layout:
                ui.label("They start in different places.")
            if settings := differing_settings(edited, evolved):
                ui.label(f"Other settings: {', '.join(settings)}. To evolve with them, press “Find a tree” in step 2.")
        with ui.row().classes("self-end gap-2"):
            ui.button("Cancel", on_click=lambda: asked.submit(None)).props(
                "no-caps flat autofocus data-testid=goal-cancel"
            )
            ui.button("Go on as before", on_click=lambda: asked.submit(changes)).props(
                "no-caps unelevated data-testid=goal-own"
            )
            if same_things(evolved, edited) and not same_places(evolved, edited):
                for_edited = dataclasses.replace(changes, task=edited)
                ui.button("Go on with the new task", on_click=lambda: asked.submit(for_edited)).props(
                    "no-caps unelevated data-testid=goal-edited"
                )
    chosen = await asked
    if chosen is not None and studio.evolution.run != run:
        raise UserError("another run was opened meanwhile; look at it, then press Go on again")
    return chosen


def _sentences(task: Task) -> list[str]:
    words = Words(task)
    return [f"{words.named(target.object)} {words.target(target)}" for target in task.targets]


def _column(title: str, sentences: Sequence[str]) -> None:
    with ui.column().classes("gap-0"):
        heading(title)
        with ui.element("ul").classes("lesson-list"):
            for sentence in sentences:
                with ui.element("li"):
                    ui.label(sentence)
