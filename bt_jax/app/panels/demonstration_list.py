"""The demonstrations that are kept: replayed, renamed, deleted, left out, and laid over each other in the scene."""

from __future__ import annotations

import functools
from collections.abc import Awaitable, Callable

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.parts import button, heading, known, mark
from bt_jax.app.state.demonstration_library import ListedDemonstration
from bt_jax.app.state.overlay import overlaid
from bt_jax.app.state.studio import Studio
from bt_jax.app.units import length
from bt_jax.app.widgets.dialogs import ask, ask_for
from bt_jax.app.widgets.scene_view import Ghost
from bt_jax.lfd.disagreement import Disagreement

__all__ = ["DemonstrationList"]


class DemonstrationList:
    """Built into the container that is open; `clear` takes what is laid over the scene out of it."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page, self.teaching, self.library = studio, page, studio.teaching, studio.library
        self._listed: object = None
        self._laid: frozenset[str] = frozenset()  # names of the demonstrations that are laid over the scene
        with ui.row().classes("items-center gap-2 w-full"):
            heading("Demonstrations").classes("flex-1")
            self.all = button("Lay all over the scene", "demonstrate-overlay", "layers", page.guard(self._lay_all))
            self.all.props("outline")
        self.odd = ui.element("div").classes("teach").props("data-testid=demonstrate-odd role=status")
        self.list = ui.element("div").classes("teach-list").props("data-testid=demonstrate-list role=list")

    def clear(self) -> None:
        """Take everything out of the scene."""
        self.page.scene.ghost({}, group="overlay")

    def refresh(self) -> None:
        """Show the demonstrations as they are."""
        library = self.library
        useful = {one.name for one in library.kept if one.counts}
        self._laid &= useful
        self._lay_over()
        self.all.set_visibility(len(useful) > 1 and library.lesson is not None)
        self.all.set_text("Take all away" if self._laid else "Lay all over the scene")
        shown = (library.kept, library.disagreements, self.teaching.replayed, self._laid)
        if shown == self._listed:
            return
        self._listed = shown
        self.odd.clear()
        with self.odd:
            for one in library.disagreements:
                self._disagreement(one)
        self.list.clear()
        with self.list:
            for kept in library.kept:
                self._row(kept)
            if not library.kept:
                ui.label("none yet").classes("teach-hint").props("role=listitem")

    def _lay_over(self) -> None:
        lesson = self.library.lesson
        places = [] if lesson is None else overlaid(lesson, self.page.scene.world, self._laid)
        copies = {
            f"{number} {one.demonstration}": Ghost(
                one.thing, one.pose, f"{one.demonstration}: {one.thing}", odd=one.disagrees
            )
            for number, one in enumerate(places)
        }
        self.page.scene.ghost(copies, group="overlay")

    def _lay_all(self) -> None:
        self._laid = frozenset() if self._laid else frozenset(one.name for one in self.library.kept if one.counts)
        self.refresh()

    def _lay(self, name: str) -> None:
        self._laid ^= {name}
        self.refresh()

    def _disagreement(self, one: Disagreement) -> None:
        task = self.studio.edited.task
        of = known(one.frame, task, robot="the table")
        with ui.row().classes("teach-landing teach-bad items-center gap-2 no-wrap"):
            ui.label(
                f"{one.name} puts {one.object} {length(one.away)} from where {one.agreeing} others put it, as seen "
                f"from {of}."
            ).classes("flex-1")
            leave = button(
                "", "", "block", self.page.guard(functools.partial(self._leave_out, one.name)), more="outline"
            )
            mark(leave, f"demonstrate-odd-{one.name}").set_text(f"Leave {one.name} out")

    def _row(self, one: ListedDemonstration) -> None:
        playing, laid = self.teaching.replayed == one.name, one.name in self._laid
        row = ui.element("div").classes("teach-row").props("role=listitem")
        with mark(row, f"demonstrate-row-{one.name}"):
            with ui.element("div").classes("teach-what"):
                ui.label(one.name).classes("text-bold")
                said = one.problem or (one.summary if one.left_out else f"moves {one.summary}")
                ui.label(said).classes("teach-bad" if one.problem else "teach-hint")
            self._action(
                one,
                "lay",
                "layers_clear" if laid else "layers",
                "Take away" if laid else "Lay over the scene",
                self._lay,
            ).set_enabled(one.counts and self.library.lesson is not None)
            replay = self._action(
                one, "replay", "stop" if playing else "play_arrow", "Stop" if playing else "Replay", self._replay
            )
            replay.set_enabled(not one.problem and not one.left_out)
            if one.left_out:
                self._action(one, "leave", "add", "Take in again", self._take_in)
            else:
                self._action(one, "leave", "block", "Leave out", self._leave_out)
            self._action(one, "rename", "edit", "Rename", self._rename)
            self._action(one, "delete", "delete", "Delete", self._delete)

    def _action(
        self,
        one: ListedDemonstration,
        key: str,
        icon: str,
        text: str,
        handler: Callable[[str], Awaitable[None] | None],
    ) -> ui.button:
        made = button("", "", icon, self.page.guard(functools.partial(handler, one.name)), more="flat")
        return mark(made, f"demonstrate-{key}-{one.name}", aria_label=f"{text} {one.name}", title=text)

    async def _leave_out(self, name: str) -> None:
        await self.library.leave_out(name, True)
        self.page.say(f"{name} is left out, and kept: take it in again whenever you like.", "success")

    async def _take_in(self, name: str) -> None:
        await self.library.leave_out(name, False)
        self.page.say(f"{name} is taken in again. {self.library.progress}", "success")

    async def _rename(self, name: str) -> None:
        chosen = self.library.set_name
        new = await ask_for(f"New name of {name}", value=name, yes="Rename", testid="demonstrate-rename")
        if new is not None and new.strip() != name:
            self._check_set(chosen)
            await self.library.rename(name, new)

    async def _delete(self, name: str) -> None:
        chosen = self.library.set_name
        if await ask(f"Move {name} into the trash?", yes="Delete", testid="demonstrate-delete"):
            self._check_set(chosen)
            self.teaching.stop_replay()
            await self.library.delete(name)
            self.page.say(f"{name} is deleted. {self.library.progress}", "success")

    def _check_set(self, chosen: str) -> None:
        if self.library.set_name != chosen:
            raise UserError("another set was chosen meanwhile, so nothing was changed; choose the set again")

    async def _replay(self, name: str) -> None:
        if self.teaching.replayed == name:
            self.teaching.stop_replay()
            self.studio.bus.changed("demonstrations")
        else:
            await self.teaching.replay(name)
