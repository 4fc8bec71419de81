"""Step 8: what is kept in the folder. The runs; tasks, demonstrations, trees and kits; and the trash."""

from __future__ import annotations

from nicegui import ui

from bt_jax.app.panels.keep_runs import KeptRuns
from bt_jax.app.panels.keep_things import KeptThings
from bt_jax.app.panels.keep_trash import KeptTrash
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext

__all__ = ["build"]

PARTS = {"runs": "Runs", "things": "Tasks, demonstrations, trees", "trash": "Trash"}


def build(studio: Studio, page: PageContext) -> None:
    """Build the choice of a part, and the three parts, of which one is shown."""
    with ui.element("div").classes("keep"):
        choice = ui.toggle(PARTS, value="runs").props("dense no-caps unelevated data-testid=keep-part aria-label=Part")
        for name, part in (("runs", KeptRuns), ("things", KeptThings), ("trash", KeptTrash)):
            with ui.element("div").classes("keep-part").bind_visibility_from(choice, "value", value=name):
                part(studio, page)
