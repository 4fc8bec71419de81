"""The trash: what was deleted, to be restored or deleted for good."""

from __future__ import annotations

import asyncio
import functools

from nicegui import ui

from bt_jax._util.words import counted
from bt_jax.app.panels.parts import button, mark
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.trash import KINDS, Trashed
from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.dialogs import ask

__all__ = ["KeptTrash"]


class KeptTrash:
    """The list, and the buttons to restore each thing and to empty the trash."""

    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page = studio, page
        self.hint = ui.label().props("data-testid=trash-hint")
        self.list = ui.element("div").classes("teach-list").props("role=list")
        self.empty = button("Empty the trash", "trash-empty", "delete_forever", page.guard(self._empty))
        page.on("trash", self._show)

    async def _show(self) -> None:
        entries = await asyncio.to_thread(self.studio.keeping.trash.entries)
        self.hint.set_text(
            "What was deleted stays here until you empty the trash." if entries else "The trash is empty."
        )
        self.empty.set_enabled(bool(entries))
        self.list.clear()
        with self.list:
            for entry in entries:
                self._row(entry)

    def _row(self, entry: Trashed) -> None:
        what = f"{KINDS[entry.kind]}{f' of {entry.set}' if entry.set else ''}, deleted {entry.when:%d %B, %H:%M}"
        with mark(ui.element("div").classes("teach-row").props("role=listitem"), f"trash-row-{entry.name}"):
            with ui.element("div").classes("teach-what"):
                ui.label(entry.name).classes("text-bold")
                ui.label(what).classes("teach-hint")
            restore = self.page.guard(functools.partial(self._restore, entry))
            back = button("Restore", "", "restore_from_trash", restore, more="flat")
            mark(back, f"trash-restore-{entry.name}", aria_label=f"Restore {entry.name}")

    async def _restore(self, entry: Trashed) -> None:
        name = await self.studio.keeping.restore(entry.id)
        if entry.kind in ("demonstration", "demonstrations"):
            await self.studio.library.refresh()
        self.page.say(f"The {KINDS[entry.kind]} {name} is back.", "success")

    async def _empty(self) -> None:
        count = counted(len(self.studio.keeping.trash.entries()), "thing")
        if await ask(f"Delete {count} for good? This cannot be taken back.", yes="Delete", testid="trash-empty"):
            await self.studio.keeping.empty()
            self.page.say("The trash is empty.", "success")
