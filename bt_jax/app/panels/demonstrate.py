"""Step 3: demonstrate what evolution does not find, and keep it."""

from __future__ import annotations

import functools

from nicegui import ui

from bt_jax.app.panels.camera import CameraControls
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.demonstration_list import DemonstrationList
from bt_jax.app.panels.gripper import GripperControls
from bt_jax.app.panels.parts import button, heading
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import Step
from bt_jax.app.widgets.dialogs import ask_for
from bt_jax.app.widgets.holder_line import holder_line

__all__ = ["build"]

LAYOUTS = (
    "Things begin elsewhere in each demonstration. Only then do the demonstrations show whether a place is relative to the "
    "table, a kit, or another thing."
)


def build(studio: Studio, page: PanelContext) -> None:
    """Build the list of demonstrations, and the gripper for one in the making."""
    _Demonstrate(studio, page)


class _Demonstrate:
    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page, self.teaching, self.library = studio, page, studio.teaching, studio.library
        with ui.element("div").classes("teach"):
            self.idle = ui.element("div").classes("teach")
            with self.idle:
                self._build_idle()
            holder_line(studio.holds, page, "gripper")
            self.making = ui.element("div").classes("teach")
            with self.making:
                self.gripper = GripperControls(studio, page)
        page.on("demonstrations", self._refresh)
        page.on("lesson", self._refresh, now=False)
        page.on("tree", self._refresh, now=False)
        page.on("holds", self._lock)
        page.on_step(self._enter)

    def _build_idle(self) -> None:
        teaching, page = self.teaching, self.page
        with ui.row().classes("items-center gap-2 w-full no-wrap"):
            self.set = (
                ui.select([self.library.set_name], value=self.library.set_name, label="Set")
                .props("dense outlined data-testid=demonstrate-set")
                .classes("w-48")
            )
            self.set.on("update:model-value", page.guard(self._use_set))
            button("New set", "demonstrate-new-set", "create_new_folder", page.guard(self._new_set), more="flat")
        with ui.row().classes("items-center gap-3 no-wrap"):
            self.dots = ui.label().classes("teach-dots").props("aria-hidden=true")
            self.progress = ui.label().props("data-testid=demonstrate-progress")
        heading("New demonstration")
        with ui.row().classes("items-center gap-2"):
            button("From the start", "demonstrate-new", "add", page.guard(self._begin, steers="gripper"))
            self.reached = button(
                "From where the tree ends",
                "demonstrate-new-reached",
                "account_tree",
                page.guard(functools.partial(self._begin, reached=True), steers="gripper"),
                more="outline",
            )
        self.elsewhere = ui.checkbox("Each from another start", value=teaching.elsewhere).props(
            "dense data-testid=demonstrate-elsewhere"
        )
        self.elsewhere.on("update:model-value", self._choose_layout)
        ui.label(LAYOUTS).classes("teach-hint")
        CameraControls(self.studio, page)
        self.list = DemonstrationList(self.studio, page)

    def _lock(self) -> None:
        """Lock the gripper while another window steers it."""
        if self.studio.holds.other("gripper", self.page.window) is None:
            self.making.props(remove="inert")
        else:
            self.making.props("inert")

    async def _begin(self, *, reached: bool = False) -> None:
        await self.teaching.begin(reached=reached)
        self.gripper.focus()
        self.page.say("Take an object: drag it in the scene, click it, or press its number.")

    def _choose_layout(self) -> None:
        self.teaching.set_elsewhere(bool(self.elsewhere.value))

    async def _use_set(self) -> None:
        if self.set.value and self.set.value != self.library.set_name:
            await self.library.use_set(self.set.value)

    async def _new_set(self) -> None:
        name = await ask_for("Name of the new set", value="", yes="Create", testid="demonstrate-new-set")
        if name and name.strip():
            await self.library.use_set(name.strip())

    async def _enter(self, step: Step) -> None:
        """Show the demonstration in the making, and read what is on the disk."""
        if step != "demonstrate":
            self.gripper.clear()
            self.list.clear()
            return
        if self.teaching.session is not None:
            self.teaching.show(self.teaching.session.world)
            self.gripper.focus()
        self._refresh()
        await self.library.refresh()

    def _refresh(self) -> None:
        making = self.teaching.session is not None
        self.idle.set_visibility(not making)
        self.making.set_visibility(making)
        if making:
            self.list.clear()
            self.gripper.refresh()
        else:
            self.gripper.clear()
            self._refresh_idle()

    def _refresh_idle(self) -> None:
        studio, teaching = self.studio, self.teaching
        names = sorted({*studio.workspace.demonstration_sets(), studio.library.set_name})
        if (self.set.options, self.set.value) != (names, studio.library.set_name):
            self.set.set_options(names, value=studio.library.set_name)
        good = sum(one.counts for one in self.library.kept)
        self.dots.set_text("\N{BLACK CIRCLE}" * min(good, 3) + "\N{WHITE CIRCLE}" * max(0, 3 - good))
        self.progress.set_text(self.library.progress)
        self.elsewhere.set_value(teaching.elsewhere)
        self.reached.set_enabled(studio.playing.tree is not None)
        self.reached.props("title=''" if studio.playing.tree else "title='Evolve a tree first (step 2)'")
        self.list.refresh()
