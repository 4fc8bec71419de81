"""The start screen: pictures of the tasks, a new kit, and a file to open."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable

from nicegui import ui
from nicegui.events import UploadEventArguments

from bt_jax._util.errors import UserError
from bt_jax.app.panels.kit.edits import Edits
from bt_jax.app.panels.parts import button, heading, mark, may_leave
from bt_jax.app.state.kit.new import new_kit
from bt_jax.app.task_picture import task_picture
from bt_jax.app.widgets.task_menu import listed_tasks
from bt_jax.tasks import Task, task_names

__all__ = ["StartScreen"]

LARGEST = 1_000_000  # bytes of a file that is opened


class StartScreen:
    """Built into the container that is open, and shown if nothing was kept yet; `left` is called once a task is open."""

    def __init__(self, edits: Edits, left: Callable[[], None]) -> None:
        self.edits, self.studio, self._left = edits, edits.studio, left
        guard = edits.guard
        with ui.element("div").classes("start-screen").props("data-testid=start-screen") as self.element:
            heading("What is to be done?")
            with ui.row().classes("items-center gap-2"):
                button("New kit", "start-new", "add", guard(self._new))
                button(
                    "Open a file",
                    "start-file",
                    "folder_open",
                    lambda: self._upload.run_method("pickFiles"),
                    more="outline",
                )
                button("Back", "start-back", "arrow_back", left, more="flat")
            self._upload = ui.upload(auto_upload=True, max_file_size=LARGEST, on_upload=guard(self._file))
            self._upload.props('accept=".yaml,.yml" data-testid=start-upload').classes("hidden")
            self._cards = ui.element("div").classes("start-cards")
        if self.studio.workspace.is_empty:
            ui.timer(0, self._fill, once=True)
        else:
            self.element.set_visibility(False)

    async def show(self) -> None:
        """Show the tasks as they are in the folder."""
        self.element.set_visibility(True)
        await self._fill()

    async def _fill(self) -> None:
        names = self.studio.workspace.task_names()
        found = await asyncio.to_thread(lambda: [self._card(name) for name in listed_tasks(names)])
        self._cards.clear()
        with self._cards:
            for name, description, picture in found:
                card = mark(ui.element("button").classes("start-card"), f"start-task-{name}", type="button")
                card.on("click", self.edits.guard(functools.partial(self._open, name)), [])
                with card:
                    ui.html(picture, sanitize=False).classes("start-picture")
                    ui.label(name).classes("start-name")
                    ui.label(description).classes("hint")

    def _card(self, name: str) -> tuple[str, str, str]:
        """Return name, description and picture of a task; one that cannot be read has none."""
        try:
            task = self.studio.workspace.task(name)
        except UserError:
            return name, "cannot be read", ""
        return name, task.description if name in task_names() else "saved here", task_picture(task)

    async def _new(self) -> None:
        await self._take(lambda: new_kit(self.studio.workspace.task_names()))

    async def _open(self, name: str) -> None:
        await self._take(lambda: self.studio.workspace.task(name))

    async def _file(self, event: UploadEventArguments) -> None:
        content, name = await event.file.read(), event.file.name
        self._upload.reset()
        await self._take(lambda: self.studio.workspace.imported(name, content))

    async def _take(self, read: Callable[[], Task]) -> None:
        """Edit another task, if the changes of this one are saved or not wanted."""
        if await may_leave(self.studio):
            self.studio.open_task(read())
            self._left()
