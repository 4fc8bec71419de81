"""A camera that watches a demonstration: which one, its picture, and what it has seen."""

from __future__ import annotations

import base64

from nicegui import ui

from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.parts import button, heading
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.watching import TWIN

__all__ = ["CameraControls"]

CAMERAS = {TWIN: "Twin: a simulated person", "0": "Camera 0", "1": "Camera 1", "2": "Camera 2"}
SHOWN = 5  # lines of what was seen


class CameraControls:
    """Built into the container that is open."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.page, self.watching, self.library = page, studio.watching, studio.library
        heading("By hand, before a camera")
        with ui.row().classes("items-center gap-2"):
            self.camera = (
                ui.select(CAMERAS, value=TWIN, label="Camera")
                .props("dense outlined options-dense data-testid=demonstrate-camera")
                .classes("w-56")
            )
            self.start = button("Watch", "demonstrate-watch", "videocam", page.guard(self._watch), more="outline")
            self.end = button("End it", "demonstrate-watch-end", "stop", page.guard(self.watching.end), more="outline")
        with ui.row().classes("gap-2 no-wrap w-full") as self.seen:
            self.picture = ui.element("img").classes("teach-picture").props('alt="What the camera sees"')
            self.picture.props("data-testid=demonstrate-picture")
            self.said = ui.element("div").classes("teach-hint").props("role=log data-testid=demonstrate-watched")
        page.on("watching", self._refresh)

    def _refresh(self) -> None:
        watching = self.watching
        self.start.set_enabled(not watching.on)
        self.camera.set_enabled(not watching.on)
        self.end.set_visibility(watching.on)
        self.seen.set_visibility(watching.on or bool(watching.said))
        self.picture.set_visibility(watching.picture is not None)
        if watching.picture is not None:
            self.picture.props["src"] = f"data:image/jpeg;base64,{base64.b64encode(watching.picture).decode()}"
            self.picture.update()
        self.said.clear()
        with self.said:
            for line in watching.said[-SHOWN:] or ("The camera is being opened.",):
                ui.label(line)

    async def _watch(self) -> None:
        name = await self.watching.watch(str(self.camera.value))
        self.page.say(f"{name} is kept. {self.library.progress}", "success")
