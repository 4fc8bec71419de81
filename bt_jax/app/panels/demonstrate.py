"""Step 3: demonstrate what evolution does not find; pick, carry under the keys, let go, and keep it."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.gripper import Gripper
from bt_jax.app.panels.parts import ask, ask_for, button, heading, mark
from bt_jax.app.state.studio import Studio

if TYPE_CHECKING:
    from bt_jax.app.page import Page, Step

__all__ = ["build"]

LAYOUTS = (
    "Boxes begin elsewhere in each demonstration. Only then can it be told whether a place is meant on the table, in the "
    "kit, or at another box."
)


def build(studio: Studio, page: Page) -> None:
    """The list of demonstrations, or the gripper while one is in the making."""
    _Demonstrate(studio, page)


class _Demonstrate:
    def __init__(self, studio: Studio, page: Page) -> None:
        self.studio, self.page, self.teaching, self.shelf = studio, page, studio.teaching, studio.shelf
        with ui.element("div").classes("teach"):
            self.idle = ui.element("div").classes("teach")
            with self.idle:
                self._build_idle()
            self.making = ui.element("div").classes("teach")
            with self.making:
                self.gripper = Gripper(studio, page)
        self._listed: object = None
        page.on("demonstrations", self._refresh)
        page.on("tree", self._refresh)
        page.on_step(page.guard(self._enter))
        if not self.shelf.read:
            ui.timer(0, page.guard(self.shelf.refresh), once=True)

    def _build_idle(self) -> None:
        teaching, page = self.teaching, self.page
        with ui.row().classes("items-center gap-2 w-full no-wrap"):
            self.set = (
                ui.select([self.studio.demonstration_set], value=self.studio.demonstration_set, label="Set")
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
            button("From the start", "demonstrate-new", "add", page.guard(self._begin))
            self.reached = button(
                "From where the tree ends",
                "demonstrate-new-reached",
                "account_tree",
                page.guard(functools.partial(self._begin, reached=True)),
                more="outline",
            )
        self.elsewhere = ui.checkbox("Each in another layout", value=teaching.elsewhere).props(
            "dense data-testid=demonstrate-elsewhere"
        )
        self.elsewhere.on("update:model-value", self._choose_layout)
        ui.label(LAYOUTS).classes("teach-hint")
        heading("Demonstrations")
        self.list = ui.element("div").classes("teach-list").props("data-testid=demonstrate-list role=list")

    async def _begin(self, *, reached: bool = False) -> None:
        await self.teaching.begin(reached=reached)
        self.studio.say("Pick an object: click it, or press its number.")

    def _choose_layout(self) -> None:
        self.teaching.elsewhere = bool(self.elsewhere.value)
        self.studio.changed("demonstrations")

    async def _use_set(self) -> None:
        if self.set.value and self.set.value != self.studio.demonstration_set:
            await self.shelf.use_set(self.set.value)

    async def _new_set(self) -> None:
        name = await ask_for("Name of the new set", value="", yes="Create", testid="demonstrate-new-set")
        if name and name.strip():
            await self.shelf.use_set(name.strip())

    async def _rename(self, name: str) -> None:
        chosen = self.studio.demonstration_set
        new = await ask_for(f"New name of {name}", value=name, yes="Rename", testid="demonstrate-rename")
        if new is not None and new.strip() != name:
            self._check_set(chosen)
            await self.shelf.rename(name, new)

    async def _delete(self, name: str) -> None:
        chosen = self.studio.demonstration_set
        if await ask(f"Delete {name}? This cannot be taken back.", yes="Delete", testid="demonstrate-delete"):
            self._check_set(chosen)
            self.teaching.stop_replay()
            await self.shelf.delete(name)
            self.studio.say(f"{name} is deleted. {self.shelf.progress}")

    def _check_set(self, chosen: str) -> None:
        if self.studio.demonstration_set != chosen:
            raise UserError("another set was chosen meanwhile, so nothing was changed; choose the set again")

    async def _replay(self, name: str) -> None:
        if self.teaching.replayed == name:
            self.teaching.stop_replay()
            self.studio.changed("demonstrations")
        else:
            await self.teaching.replay(name)

    async def _enter(self, step: Step) -> None:
        """Whatever other steps have shown in the meantime, here it is the demonstration; what is on the disk is read."""
        if step != "demonstrate":
            self.gripper.clear()
            return
        if self.studio.session is not None:
            self.studio.show(self.studio.session.world)
        self._refresh()
        await self.shelf.refresh()

    def _refresh(self) -> None:
        if self.page.step != "demonstrate":
            return
        making = self.studio.session is not None
        self.idle.set_visibility(not making)
        self.making.set_visibility(making)
        if making:
            self.gripper.refresh()
        else:
            self.gripper.clear()
            self._refresh_idle()

    def _refresh_idle(self) -> None:
        studio, teaching = self.studio, self.teaching
        names = sorted({*studio.workspace.demonstration_sets(), studio.demonstration_set})
        if (self.set.options, self.set.value) != (names, studio.demonstration_set):
            self.set.set_options(names, value=studio.demonstration_set)
        good = sum(not one.problem for one in self.shelf.kept)
        self.dots.set_text("\N{BLACK CIRCLE}" * min(good, 3) + "\N{WHITE CIRCLE}" * max(0, 3 - good))
        self.progress.set_text(self.shelf.progress)
        self.elsewhere.set_value(teaching.elsewhere)
        self.reached.set_enabled(studio.tree is not None)
        self.reached.props("title=''" if studio.tree else "title='Evolve a tree first (step 2)'")
        shown = (self.shelf.kept, teaching.replayed)
        if shown == self._listed:
            return
        self._listed = shown
        self.list.clear()
        with self.list:
            for one in self.shelf.kept:
                self._row(one.name, one.summary, one.problem)
            if not self.shelf.kept:
                ui.label("none yet").classes("teach-hint")

    def _row(self, name: str, summary: str, problem: str) -> None:
        guard, playing = self.page.guard, self.teaching.replayed == name
        row = ui.element("div").classes("teach-row").props("role=listitem")
        with mark(row, f"demonstrate-row-{name}"):
            with ui.element("div").classes("teach-what"):
                ui.label(name).classes("text-bold")
                ui.label(problem or f"moves {summary}").classes("teach-bad" if problem else "teach-hint")
            for key, icon, text, handler in (
                ("replay", "stop" if playing else "play_arrow", "Stop" if playing else "Replay", self._replay),
                ("rename", "edit", "Rename", self._rename),
                ("delete", "delete", "Delete", self._delete),
            ):
                action = button("", "", icon, guard(functools.partial(handler, name)), more="flat")
                mark(action, f"demonstrate-{key}-{name}", aria_label=f"{text} {name}", title=text)
                action.set_enabled(key != "replay" or not problem)
